"""The ladder: diagnose, add the strongest finding, refit, and again, until nothing passes the gate.

The first effects explain most. Before a joint is given a second one, or once a further one would not even halve the
error, the values of all that is there are fitted together, in free roll-outs: what a wrong value leaves behind would
else be given another effect's name. After that a second effect at a joint has to take away half of what is left there,
or a share of what there was at first; less is the law of the first one, bent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from twin_daemon.comparison.compare import compare_recording, mean_over_moving, pooled, raw_command_error
from twin_daemon.diagnosis.diagnose import REFINEMENT, diagnose
from twin_daemon.diagnosis.refit import refit_effect, refit_parameters
from twin_daemon.diagnosis.verdict import Diagnosis, Finding, VerdictName
from twin_daemon.effects import LIBRARY
from twin_daemon.errors import BadInput
from twin_daemon.fitting.calibrate import FittedParameter, calibrate
from twin_daemon.fitting.spaces import load_space
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.submodel import parts
from twin_daemon.simulation.twin import TwinModel

# What the whole hand is called when its parts differ: the first of these that any part is.
_GRAVEST: tuple[VerdictName, ...] = ("unexplained", "ambiguous", "explained", "within_noise", "not_excited")

_NOTHING_MOVES = "no joint moves by more than 0.05 rad: record steps, two speeds, small reversals and holds"

_TOGETHER = "with-effects"  # the space of all values

Say = Callable[[str], None]


@dataclass(frozen=True)
class Step:
    """The twin after one more effect, and what the diagnosis says of it then.

    `effect` is None in the first step, and in one that fits the values of all effects and parameters `together`.
    Errors in rad^2 over the joints that move. `parameters` are the effect's fitted values.
    """

    effect: str | None
    target: str | None
    joints: tuple[str, ...]
    parameters: dict[str, float]
    mse_rad2: float | None
    holdout_mse_rad2: float | None
    verdict: VerdictName | None
    together: bool = False


@dataclass
class Ladder:
    """What has been climbed. `twin` has all effects of the steps. `refused` are findings that did not hold."""

    twin: TwinModel
    steps: list[Step]
    reason: str = ""
    refused: list[str] = field(default_factory=list)
    parameters_alone: tuple[float | None, float | None] = (None, None)
    interrupted: bool = False
    parameters: dict[str, FittedParameter] = field(default_factory=dict)

    @property
    def added(self) -> int:
        """How many effects have been added."""
        return sum(step.effect is not None for step in self.steps)

    def take_back(self, twin: TwinModel) -> None:
        """Back to the beginning: what was added is listed with what did not hold."""
        self.refused += [f"{step.effect}:{step.target}" for step in self.steps if step.effect is not None]
        self.twin, self.steps, self.parameters = twin, self.steps[:1], {}

    @property
    def last_judged(self) -> Step:
        """The last step that held-out motion has judged; the first where there is none."""
        return next((s for s in reversed(self.steps) if s.holdout_mse_rad2 is not None), self.steps[0])


def mean_error(twin: TwinModel, recordings: Sequence[Aligned]) -> float | None:
    """Mean squared error (rad^2) of the twin over the joints that move; None where there is nothing to compare."""
    if not recordings:
        return None
    return mean_over_moving(pooled([compare_recording(twin, r) for r in recordings]))


def climb(
    twin: TwinModel,
    train: Sequence[Aligned],
    holdout: Sequence[Aligned],
    *,
    max_steps: int,
    whole: Sequence[Aligned] = (),
    seed: int = 0,
    say: Say | None = None,
) -> Ladder:
    """Adds one effect after another, each fitted on `train` and counted only where `holdout` gets better by it.

    What in the end predicts held-out motion worse than the raw command does is taken back, all of it. With each effect
    the model's own parameters of its part are refitted under their priors; what these alone would do, without any
    effect, is `parameters_alone`. Where `holdout` was cut out of the same recordings, these are `whole`: in the end
    the values are fitted to all of them, and nothing is left to judge that by. Ctrl-C ends it; the steps done are in
    the answer.
    """
    speak = say or (lambda _: None)
    ladder = Ladder(twin, [_step(None, {}, twin, train, holdout, None)])
    open_parts: dict[str, Diagnosis] = {}

    def look(only: str | None) -> None:
        _look(ladder.twin, train, holdout, only, open_parts, seed, speak)
        ladder.steps[-1] = _judged(ladder.steps[-1], open_parts)

    def fit_together() -> bool:
        speak("fitting the values of all effects and parameters together")
        found = _fit_together(ladder, train, holdout, seed)
        if found:
            look(None)
        return found

    together = False
    try:
        look(None)
        at_first = dict(open_parts)
        if ladder.steps[0].verdict not in ("not_excited", "within_noise"):
            alone = twin.changed(twin.terms.with_parameters(refit_parameters(twin, train)))
            ladder.parameters_alone = (mean_error(alone, train), mean_error(alone, holdout))
        while ladder.added < max_steps:
            part, finding = _strongest(open_parts, set(ladder.refused))
            if finding is None:
                break
            speak(f"adding {finding.effect} at {finding.target}")
            step = _with(ladder, finding, train, holdout)
            if step is None:
                ladder.refused.append(_name(finding))
                continue
            again, halves = _names_again(ladder, finding), _halves(ladder.twin, step[0], finding.joints, train)
            if not together and ladder.added and (again or not halves):
                together = True
                if fit_together():
                    continue
            if again and not halves and not _large(twin, ladder.twin, step[0], finding.joints, train):
                ladder.refused.append(_name(finding))
                continue
            ladder.twin, rung = step
            ladder.steps.append(rung)
            look(None if finding.target == "hand" else part)
        if not together and ladder.added and ladder.steps[-1].verdict == "unexplained":
            fit_together()
        if _worse_than_raw(ladder, holdout):
            ladder.take_back(twin)
            open_parts = at_first
        if whole and any(step.together for step in ladder.steps):
            speak("fitting the same values to the whole recordings")
            ladder.twin, ladder.parameters = _refitted(ladder.twin, whole, seed)
            last = _step(None, {}, ladder.twin, whole, (), ladder.steps[-1].verdict)
            ladder.steps.append(replace(last, together=True))
    except KeyboardInterrupt:
        ladder.interrupted = True
    gravest = _gravest(open_parts)
    if gravest is not None:
        ladder.reason = gravest.reason
    elif not ladder.interrupted:
        ladder.reason = _NOTHING_MOVES
    return ladder


def _look(
    twin: TwinModel,
    train: Sequence[Aligned],
    holdout: Sequence[Aligned],
    only: str | None,
    open_parts: dict[str, Diagnosis],
    seed: int,
    say: Say,
) -> None:
    """Diagnoses one part again, or all: what was found in one part stays true while another one changes."""
    moving = {n for i, n in enumerate(twin.joints) if any(r.moving[i] for r in train)}
    for part in parts(twin):
        own = [n for n in part.joints if n in moving]
        if own and only in (None, part.name):
            found = diagnose(twin, train, holdout, joints=own, seed=seed, stream=say, most_effects=1)
            open_parts[part.name] = found
            if found.interrupted:
                raise KeyboardInterrupt


def _strongest(open_parts: dict[str, Diagnosis], refused: set[str]) -> tuple[str, Finding | None]:
    found = [(f.evidence, name, f) for name, d in open_parts.items() for f in d.findings if _name(f) not in refused]
    if not found:
        return "", None
    _, name, finding = max(found, key=lambda item: item[:2])
    return name, finding


def _name(finding: Finding) -> str:
    return f"{finding.effect}:{finding.target}"


def _with(
    ladder: Ladder, finding: Finding, train: Sequence[Aligned], holdout: Sequence[Aligned]
) -> tuple[TwinModel, Step] | None:
    """The twin with a finding, refitted; None where it cannot stand beside the others or held-out motion gets worse."""
    twin, effect = ladder.twin, LIBRARY[finding.effect]
    start = effect.complete({name: p.value for name, p in finding.parameters.items()})
    try:
        refit = refit_effect(twin, train, effect, [finding.target], {}, start=start)
        terms = twin.terms.with_effect(refit.terms[0]).with_parameters(refit.parameters)
        changed = twin.changed(terms)
    except BadInput:
        return None
    values = {name: refit.terms[0].values[name] for name in finding.parameters}
    step = _step(finding, values, changed, train, holdout, None)
    return (changed, step) if _better(step, ladder.steps[-1]) else None


def _better(step: Step, before: Step) -> bool:
    new, old = step.holdout_mse_rad2, before.holdout_mse_rad2
    return new is not None and old is not None and new < old


def _worse_than_raw(ladder: Ladder, holdout: Sequence[Aligned]) -> bool:
    """Whether held-out motion is predicted better by the command itself than by what has been climbed to."""
    if not ladder.added or not holdout:
        return False
    raw, reached = raw_command_error(ladder.twin, holdout), ladder.last_judged.holdout_mse_rad2
    return raw is not None and reached is not None and reached >= raw


def _halves(before: TwinModel, after: TwinModel, joints: Sequence[str], recordings: Sequence[Aligned]) -> bool:
    """Whether the error of these joints falls by half or more."""
    old, new = (
        mean_over_moving(pooled([compare_recording(twin, r) for r in recordings]), joints) for twin in (before, after)
    )
    return old is not None and new is not None and new < 0.5 * old


def _names_again(ladder: Ladder, finding: Finding) -> bool:
    """Whether the joints of a finding have been given an effect before."""
    return any(set(finding.joints) & set(step.joints) for step in ladder.steps if step.effect is not None)


def _large(
    first: TwinModel, before: TwinModel, after: TwinModel, joints: Sequence[str], recordings: Sequence[Aligned]
) -> bool:
    """Whether a further effect takes a share of the error that these joints had at first: smaller ones bend a law."""
    start, old, new = (
        mean_over_moving(pooled([compare_recording(twin, r) for r in recordings]), joints)
        for twin in (first, before, after)
    )
    return start is not None and old is not None and new is not None and old - new >= REFINEMENT * start


def _fit_together(ladder: Ladder, train: Sequence[Aligned], holdout: Sequence[Aligned], seed: int) -> bool:
    """Fits all values at once, and keeps them if held-out motion gets better; whether it did."""
    found = calibrate(ladder.twin, train, holdout, load_space(_TOGETHER), "multi-start", seed=seed)
    changed = ladder.twin.changed(found.terms)
    step = replace(_step(None, {}, changed, train, holdout, None), together=True)
    if _better(step, ladder.steps[-1]):
        ladder.twin, ladder.parameters = changed, found.parameters
        ladder.steps.append(step)
    if found.interrupted:
        raise KeyboardInterrupt
    return ladder.steps[-1] is step


def _refitted(
    twin: TwinModel, recordings: Sequence[Aligned], seed: int
) -> tuple[TwinModel, dict[str, FittedParameter]]:
    """The values fitted together again, on other recordings."""
    found = calibrate(twin, recordings, (), load_space(_TOGETHER), "multi-start", seed=seed)
    return twin.changed(found.terms), found.parameters


def _step(
    finding: Finding | None,
    values: dict[str, float],
    twin: TwinModel,
    train: Sequence[Aligned],
    holdout: Sequence[Aligned],
    verdict: VerdictName | None,
) -> Step:
    return Step(
        effect=finding.effect if finding else None,
        target=finding.target if finding else None,
        joints=finding.joints if finding else (),
        parameters=values,
        mse_rad2=_finite(mean_error(twin, train)),
        holdout_mse_rad2=_finite(mean_error(twin, holdout)),
        verdict=verdict,
    )


def _finite(value: float | None) -> float | None:
    return value if value is not None and np.isfinite(value) else None


def _gravest(open_parts: dict[str, Diagnosis]) -> Diagnosis | None:
    return min(open_parts.values(), key=lambda d: _GRAVEST.index(d.verdict), default=None)


def _judged(step: Step, open_parts: dict[str, Diagnosis]) -> Step:
    gravest = _gravest(open_parts)
    verdict: VerdictName = gravest.verdict if gravest is not None else "not_excited"
    return replace(step, verdict=verdict)
