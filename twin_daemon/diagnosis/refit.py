"""The values of one named effect, fitted to recordings beside what is uncertain about the model anyway."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin_daemon.diagnosis.as_fitted import with_uncertain_links
from twin_daemon.diagnosis.candidates import Hypothesis, candidate, informed
from twin_daemon.diagnosis.fit import Fit, own_columns, own_estimates
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.shared import SharedSearch
from twin_daemon.diagnosis.shared_cause import SharedCause
from twin_daemon.diagnosis.thresholds import FULL_FIT_ROLLOUTS, REFIT_ROLLOUTS, REFIT_ROUNDS, REFIT_STARTS, SETTLED
from twin_daemon.effects.base import Effect
from twin_daemon.errors import BadInput
from twin_daemon.estimation.partition import Reduction
from twin_daemon.estimation.posterior import Posterior
from twin_daemon.estimation.solvers.trust_region import Derivative, Descent, descend
from twin_daemon.estimation.uncertainty import Estimate
from twin_daemon.estimation.windows import segments
from twin_daemon.executor import concurrently
from twin_daemon.places import HAND, ROBOT
from twin_daemon.simulation.alignment import Aligned, judged_joints
from twin_daemon.simulation.submodel import Part, drive_groups, parts
from twin_daemon.simulation.terms import EffectTerm
from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True)
class Refit:
    """The effect's terms with fitted values, and these by "key:target.parameter".

    `parameters` are the model's own, absolute, where they came to lie beside the effect.
    """

    terms: tuple[EffectTerm, ...]
    values: dict[str, Estimate]
    parameters: dict[str, float]
    notes: list[str]


def refit_effect(
    twin: TwinModel,
    recordings: Sequence[Aligned],
    effect: Effect,
    targets: Sequence[str],
    given: Mapping[str, float],
    *,
    start: Mapping[str, float] | None = None,
) -> Refit:
    """Fits an effect at its targets, `given` values fixed, group by group where groups move on their own.

    Descends from the effect's own starts, or from `start` alone where the values are known approximately.

    Damping, friction, armature, gain and delay move along under their priors, so that a friction that is 10 % off
    does not bend the effect's values. At the whole robot there is one set of values for all servos. Raises BadInput
    where nothing concerned moves.
    """
    if ROBOT in targets:
        return refit_shared(twin, recordings, effect, given, start=start)
    moving = set(judged_joints(twin, recordings))
    reduction = with_uncertain_links(twin, Reduction(twin, recordings, ()))
    terms: list[EffectTerm] = []
    values: dict[str, Estimate] = {}
    parameters: dict[str, float] = {}
    notes: list[str] = []
    for part, own in _groups(twin, effect, targets):
        joints = [n for n in twin.joints if n in part.joints and n in moving]
        still = [t for t in own if t != "hand" and not set(twin.joints_of(t)) & moving]
        if still or not joints:
            raise _does_not_move(still or own, effect)
        small, pieces = _pieces(twin, reduction, recordings, part, joints)
        hypotheses = [_hypothesis(small, effect, target, joints[0], start) for target in own]
        best = _fit(PartFit(small, pieces, joints), hypotheses, given, guess=start is None)
        parameters |= best.moved
        for hypothesis in hypotheses:
            term, found = _read(best, hypothesis)
            terms.append(term)
            values |= found
    for name, value in values.items():
        if value.at_bound:
            notes.append(f"{name} sits on the end of its range: the effect may be the wrong one")
    return Refit(tuple(terms), values, parameters, notes)


def refit_shared(
    twin: TwinModel,
    recordings: Sequence[Aligned],
    effect: Effect,
    given: Mapping[str, float],
    *,
    start: Mapping[str, float] | None = None,
) -> Refit:
    """Fits one set of values for all servos of the robot to what moves, as the diagnosis does.

    The model's own parameters of each group are then fitted beside it. Raises BadInput where nothing moves.
    """
    moving = set(judged_joints(twin, recordings))
    driven = [n for n in twin.joints_of(ROBOT) if n in moving]
    if not driven:
        raise _does_not_move([ROBOT], effect)
    reduction = Reduction(twin, recordings, ())
    chosen = [(group, [n for n in driven if n in group.joints]) for group in drive_groups(twin)]
    cut = [reduced for group, own in chosen if own and (reduced := reduction.of(twin, group, own)) is not None]
    if not cut:
        raise _touches_all_the_time(ROBOT)
    looked_at = concurrently(lambda reduced: (reduced, PartFit(reduced.twin, reduced.train, reduced.joints)), cut)
    cause = SharedCause(effect, ROBOT, given)
    search = SharedSearch(twin, reduction, looked_at)
    forms = search.begun(cause) if start is None else [search.at(cause, start)]
    if not forms:
        raise BadInput(f"'{effect.key}' cannot stand beside what the servos have", todo="Name servos with --joint")
    found, slopes, there = forms[0], np.zeros((len(forms[0].rows), 0)), search
    if cause.amplitudes:
        best = min((search.fitted(one)[0] for one in forms), key=lambda one: one.cost)
        found, slopes, there = search.settled(best)
    beside = there.beside(cause, found.values)
    return Refit(
        (cause.term(found.values),),
        {f"{cause.name}.{name}": one for name, one in there.estimates(found, slopes).items()},
        {name: value for _, part in beside for name, value in part.base.moved.items()},
        [],
    )


def _does_not_move(places: Sequence[str], effect: Effect) -> BadInput:
    return BadInput(
        f"{', '.join(places)} does not move in these recordings: nothing to fit '{effect.key}' to",
        todo="Record a motion of it, or add the effect with --set and without --recording",
    )


def _touches_all_the_time(name: str) -> BadInput:
    return BadInput(
        f"{name} touches something nearly all the time in these recordings: nothing to fit to",
        todo="Record some seconds of motion clear of contacts",
    )


def refit_parameters(twin: TwinModel, recordings: Sequence[Aligned]) -> dict[str, float]:
    """What the model's own parameters come to under their priors, without any new effect: absolute, by name."""
    moving = set(judged_joints(twin, recordings))
    reduction = Reduction(twin, recordings, ())
    parameters: dict[str, float] = {}
    for part in parts(twin):
        joints = [n for n in part.joints if n in moving]
        if joints:
            reduced = reduction.of(twin, part, joints)
            if reduced is not None:
                parameters |= PartFit(reduced.twin, reduced.train, joints, thoroughly=True).base.moved
    return parameters


def _groups(twin: TwinModel, effect: Effect, targets: Sequence[str]) -> list[tuple[Part, list[str]]]:
    """(joints that are judged, targets that are fitted together): what one servo moves, as in a diagnosis.

    A load is felt by all joints that carry it: it is judged by its whole part.
    """
    if HAND in targets:
        return [(Part(HAND, twin.joints, ()), list(targets))]
    cut = parts(twin) if effect.shared == "load" else drive_groups(twin)
    groups = [(part, [t for t in targets if set(twin.joints_of(t)) & set(part.joints)]) for part in cut]
    return [(part, own) for part, own in groups if own]


def _pieces(
    twin: TwinModel, reduction: Reduction, recordings: Sequence[Aligned], part: Part, joints: Sequence[str]
) -> tuple[TwinModel, Sequence[Aligned]]:
    if part.name == HAND:
        return twin, [piece for r in recordings for piece in segments(r, joints)]
    reduced = reduction.of(twin, part, joints)
    if reduced is None:
        raise _touches_all_the_time(part.name)
    return reduced.twin, reduced.train


def _fit(part: PartFit, hypotheses: Sequence[Hypothesis], given: Mapping[str, float], *, guess: bool = False) -> Fit:
    """The best descent of the hypotheses' parameters, together, and of all that is uncertain, as a diagnosis ends it.

    With `guess` from the starts that the error without them suggests, where an effect has such.
    """
    small, pieces, joints = part.twin, part.recordings, part.joints
    if guess:
        without = part.problem.over(pieces, (), part.corrections)
        gaps = [gap[0] for gap in without.joint_residuals(np.zeros((1, 0)))]
        hypotheses = [informed(h, small, pieces, joints, gaps) for h in hypotheses]
    trials: list[tuple[float, int, Posterior]] = []
    refused: BadInput | None = None
    for number in range(max(len(h.starts) for h in hypotheses)):
        starts = [(h, {**h.starts[min(number, len(h.starts) - 1)], **given}) for h in hypotheses]
        try:
            problem = part.problem_with(*starts, held=given)
        except BadInput as error:  # a start that this model has no room for, such as less friction than none
            refused = error
            continue
        rows = problem.residuals(problem.start[None])[0]
        trials.append((float(rows @ rows), number, problem))
    if not trials and refused is not None:
        raise refused
    trials.sort(key=lambda trial: trial[:2])
    begun = [(problem, _descended(problem)) for _, _, problem in trials[:REFIT_STARTS]]
    problem, found = min(begun, key=lambda item: float(item[1].rows @ item[1].rows))
    return part.ended(hypotheses[0], problem, found.point, FULL_FIT_ROLLOUTS)


def _descended(problem: Posterior) -> Descent:
    """Down in rounds with new derivatives each, as long as they gain."""
    own, point = own_columns(problem), problem.start
    for _ in range(REFIT_ROUNDS):
        found = descend(problem, point, Derivative(problem, own), evaluations=REFIT_ROLLOUTS)
        point = found.point
        if found.rows @ found.rows > SETTLED * found.began:
            break
    return found  # pyright: ignore[reportPossiblyUnboundVariable]


def _hypothesis(
    twin: TwinModel, effect: Effect, target: str, joint: str, start: Mapping[str, float] | None
) -> Hypothesis:
    asked = candidate(effect, target, twin, joint)
    return asked if start is None else replace(asked, starts=(effect.complete(start),))


def _read(fit: Fit, hypothesis: Hypothesis) -> tuple[EffectTerm, dict[str, Estimate]]:
    """The fitted term of one target, and its values with their intervals by "key:target.parameter"."""
    seen = replace(fit, hypothesis=hypothesis)
    found = own_estimates(seen, seen_by=fit)
    return hypothesis.term(seen.values), {f"{hypothesis.name}.{name}": one for name, one in found.items()}
