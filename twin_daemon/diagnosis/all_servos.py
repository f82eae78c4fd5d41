"""A cause found at one servo after another with the same value is one cause of all servos."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin_daemon.diagnosis.conclude import Accepted, Outcome
from twin_daemon.diagnosis.fit import own_estimates
from twin_daemon.diagnosis.shared_cause import SharedCause
from twin_daemon.diagnosis.thresholds import DECISIVE_NATS, SAME_VALUE
from twin_daemon.diagnosis.verdict import Finding
from twin_daemon.effects import LIBRARY
from twin_daemon.estimation.estimate import Estimate
from twin_daemon.estimation.thresholds import Z95
from twin_daemon.places import ROBOT


def of_all_servos(outcomes: Sequence[Outcome]) -> tuple[Finding, tuple[Outcome, ...]] | None:
    """(a cause that most parts above the floor were found to have alike, the outcomes without it), or None.

    Values of its own for each servo have to be worth as much as another finding each, over one value for all.
    """
    above = [outcome for outcome in outcomes if not outcome.within_floor]
    if any(outcome.unfinished for outcome in above):
        return None
    for effect in LIBRARY.values():
        if effect.shared != "servos":
            continue
        theirs = [(o, a) for o in above for a in o.accepted if a.hypothesis.effect.key == effect.key]
        if len(theirs) < 2 or 2 * len(theirs) <= len(above):
            continue
        cause = SharedCause(effect, ROBOT)
        found = [own_estimates(one.fit) for _, one in theirs]
        means = {name: _mean([values[name] for values in found]) for name in cause.amplitudes}
        if all(apart < DECISIVE_NATS * (len(found) - 1) for _, apart in means.values()):
            finding = _finding(cause, {name: mean for name, (mean, _) in means.items()}, theirs)
            return finding, tuple(_without(outcome, effect.key) for outcome in outcomes)
    return None


def _mean(estimates: Sequence[Estimate]) -> tuple[Estimate, float]:
    """(the mean by what each is worth, how many nats values of their own are worth over it)."""
    values = np.array([one.value for one in estimates])
    sigmas = np.array([max((one.ci95[1] - one.ci95[0]) / 2 / Z95, 1e-12) for one in estimates])
    weights = sigmas**-2
    mean = float(weights @ values / weights.sum())
    # what is wrong with the model is wrong at all of them: no surer than the surest
    half = Z95 * float(sigmas.min())
    apart = 0.5 * float((((values - mean) / np.maximum(sigmas, SAME_VALUE * abs(mean) / Z95)) ** 2).sum())
    return estimates[0].model_copy(update={"value": mean, "ci95": (mean - half, mean + half)}), apart


def _without(outcome: Outcome, key: str) -> Outcome:
    rest = [one for one in outcome.accepted if one.hypothesis.effect.key != key]
    if len(rest) == len(outcome.accepted):
        return outcome
    return replace(outcome, accepted=rest, within_floor=outcome.within_floor or (not rest and outcome.explains))


def _finding(
    cause: SharedCause, parameters: dict[str, Estimate], theirs: Sequence[tuple[Outcome, Accepted]]
) -> Finding:
    before = float(np.mean([one.judged.mse_before for _, one in theirs]))
    after = float(np.mean([one.judged.mse_after for _, one in theirs]))
    intervals = [one.judged.gain_ci95 for _, one in theirs]
    rivals = [{rival.hypothesis.effect.key for rival in one.rivals} for _, one in theirs]
    return Finding(
        effect=cause.effect.key,
        target=ROBOT,
        joints=tuple(dict.fromkeys(joint for _, one in theirs for joint in one.joints)),
        parameters=parameters,
        values=cause.term({name: one.value for name, one in parameters.items()}).values,
        moved={name: value for _, one in theirs for name, value in one.fit.moved.items()},
        evidence_nats=sum(one.part.evidence_nats(one.fit) for _, one in theirs),
        holdout_mse_before_rad2=before,
        holdout_mse_after_rad2=after,
        holdout_gain=1.0 - after / max(before, 1e-30),
        holdout_gain_ci95=(min(low for low, _ in intervals), max(high for _, high in intervals)),
        confusable_with=tuple(f"{key}:{ROBOT}" for key in sorted(set.intersection(*rivals))),
        probability=min((1.0 - o.what_is_left.unknown()) * one.posterior()[one.hypothesis.name] for o, one in theirs),
        explanation=cause.effect.story.explanation,
    )
