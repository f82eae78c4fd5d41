"""One recalibration: a Bayesian search around the version in use, and, where values are not enough, a diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from twin_daemon.calibration.calibrate import Calibration, calibrate
from twin_daemon.calibration.spaces import Space, load_space, variables_of
from twin_daemon.diagnosis.stepwise import Ladder, stepwise
from twin_daemon.estimation.solvers.tracker import Progress
from twin_daemon.estimation.uncertainty import Estimate
from twin_daemon.estimation.variables import Remembered
from twin_daemon.processor_time import TimeLimit
from twin_daemon.recalibration.decide import Decision, decide
from twin_daemon.simulation.alignment import Aligned, moving_joints
from twin_daemon.simulation.twin import TwinModel

SPACE = "wear"
_PROMISE = 2.0  # so many times the error that a version promised, parameters alone do not explain the change
_HALF = 0.5  # where nothing was promised: so much of the error may be left
_CLEARLY = 0.8  # of the fitted error: below it an effect is preferred to parameters
_MOST_EFFECTS = 2
_SEARCH = "bayes-descent"
_SEARCHING = 0.4  # of the time; the rest is for intervals and a diagnosis


@dataclass(frozen=True)
class Recalibration:
    """What was found. `twin` is the better of the two ways; `ladder` is None where parameters were enough."""

    twin: TwinModel
    decision: Decision
    parameters: dict[str, Estimate]
    calibration: Calibration
    ladder: Ladder | None
    appeared: tuple[str, ...]


def recalibrate(
    twin: TwinModel,
    train: Sequence[Aligned],
    held: Sequence[Aligned],
    *,
    promised_rad2: float | None = None,
    joints: Sequence[str] = (),
    budget: int | None = None,
    seconds: float | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    say: Callable[[str], None] = lambda _: None,
    remembered: Mapping[str, Remembered] | None = None,
) -> Recalibration:
    """Refits the twin to what its hand does now.

    `promised_rad2` is the held-out error that the version showed when it was made; `joints` are those that drifted
    (all that move without them). It takes `seconds` of all cores: of these the search has two fifths, and what is
    left when it has been judged goes to a diagnosis, where one is needed. A KeyboardInterrupt ends the search, with the
    best so far and without a diagnosis. `remembered` is what the version in use knows of its values, by name.
    """
    limit = TimeLimit(seconds)
    space = _around(load_space(SPACE), joints)
    moving = moving_joints(train)
    started = {variable.name: variable.start for variable in variables_of(space, twin, moving)}
    say("searching around the version in use")
    time_s = None if seconds is None else _SEARCHING * seconds
    fitted = calibrate(
        twin,
        train,
        held,
        space,
        _SEARCH,
        budget=budget,
        seconds=time_s,
        seed=seed,
        progress=progress,
        remembered=remembered,
    )
    after = twin.changed(fitted.terms)
    decision = decide(twin, after, held, fitted.parameters, started, seed)
    bound_rad2 = _HALF * decision.before_rad2 if promised_rad2 is None else _PROMISE * promised_rad2
    enough = decision.after_rad2 <= bound_rad2
    if fitted.interrupted or (enough and decision.better):
        return Recalibration(after, decision, fitted.parameters, fitted, None, ())
    say("parameters alone do not explain the change: looking for an effect that has appeared")
    ladder = stepwise(twin, train, held, max_steps=_MOST_EFFECTS, limit=limit, seed=seed, say=say)
    if ladder.added:
        other = decide(twin, ladder.twin, held, ladder.parameters, {}, seed)
        if other.after_rad2 < _CLEARLY * decision.after_rad2:
            named = tuple(step.name for step in ladder.steps if step.effect is not None)
            return Recalibration(ladder.twin, other, ladder.parameters, fitted, ladder, named)
    return Recalibration(after, decision, fitted.parameters, fitted, ladder, ())


def _around(space: Space, joints: Sequence[str]) -> Space:
    """The space with only these joints, where some are named."""
    if not joints:
        return space
    entries = [e.model_copy(update={"of": list(joints)}) if e.of == ["moving"] else e for e in space.parameters]
    return space.model_copy(update={"parameters": entries})
