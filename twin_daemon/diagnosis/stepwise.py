"""The ladder: diagnose, add the strongest finding, refit, and again, until nothing passes held-out validation.

A cause that several groups of joints feel at once, such as a late bus, is looked for first, over the whole robot.

The first effects explain most: each part of the hand is given its own, the strongest first, before any is looked at
again. Where several parts have been given one, before a joint is given a second one, or once a further one would not
even halve the error, the values of all that is there are fitted together, in free roll-outs: what a wrong value leaves
behind would else be given another effect's name. From then on an effect has to take away half of what is left at its
joints, or a share of what they had at first: less only bends the laws of those that are there.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from twin_daemon.calibration.calibrate import Calibration, calibrate
from twin_daemon.calibration.spaces import load_space
from twin_daemon.comparison.compare import raw_command_error
from twin_daemon.diagnosis.free_rollout import mean_error, with_finding
from twin_daemon.diagnosis.part_looks import PartLooks
from twin_daemon.diagnosis.refit import refit_parameters
from twin_daemon.diagnosis.thresholds import MOST_OF_IT, REFINEMENT
from twin_daemon.diagnosis.verdict import Finding, Step
from twin_daemon.errors import BadInput
from twin_daemon.estimation.estimate import Estimate
from twin_daemon.places import HAND, ROBOT
from twin_daemon.processes import Say
from twin_daemon.processor_time import TimeLimit
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel

_NOTHING_MOVES = "no joint moves by more than 0.05 rad: record steps, two speeds, small reversals and holds"

_TOGETHER = "with-effects"  # the space of all values


@dataclass
class Ladder:
    """What the steps have come to. `twin` has all effects of the steps. `refused` are findings that did not hold."""

    twin: TwinModel
    steps: list[Step]
    reason: str = ""
    refused: list[str] = field(default_factory=list)
    parameters_alone: tuple[float | None, float | None] = (None, None)
    interrupted: bool = False
    ended_early: bool = False
    parameters: dict[str, Estimate] = field(default_factory=dict)

    @property
    def added(self) -> int:
        """How many effects have been added."""
        return sum(step.effect is not None for step in self.steps)

    @property
    def last_judged(self) -> Step:
        """The last step that held-out motion has judged; the first where there is none."""
        return next((s for s in reversed(self.steps) if s.holdout_mse_rad2 is not None), self.steps[0])

    def spares(self, joints: Sequence[str]) -> bool:
        """Whether none of some joints has been given an effect."""
        return not any(set(joints) & set(step.joints) for step in self.steps if step.effect is not None)

    def take_back(self, twin: TwinModel) -> None:
        """Back to the beginning: what was added is listed with what did not hold."""
        self.refused += [f"{step.effect}:{step.target}" for step in self.steps if step.effect is not None]
        self.twin, self.steps, self.parameters = twin, self.steps[:1], {}


def stepwise(
    twin: TwinModel,
    train: Sequence[Aligned],
    holdout: Sequence[Aligned],
    *,
    max_steps: int,
    whole: Sequence[Aligned] = (),
    limit: TimeLimit | None = None,
    fitted_after: bool = False,
    seed: int = 0,
    say: Say | None = None,
) -> Ladder:
    """Adds one effect after another, each fitted on `train` and counted only where `holdout` gets better by it.

    What in the end predicts held-out motion worse than the raw command does is taken back, all of it. With each effect
    the model's own parameters of its part are refitted under their priors; what these alone would do, without any
    effect, is `parameters_alone`. Where `holdout` was cut out of the same recordings, these are `whole`: in the end
    the values are fitted to all of them, and nothing is left to judge that by. Ctrl-C ends it; the steps done are in
    the answer. Once `limit` is over nothing is looked at any more; what has been found until then is added. With
    `fitted_after` all values are then fitted to the end all the same.
    """
    run = _Stepwise(twin, train, holdout, limit or TimeLimit(), seed, say or (lambda _: None), fitted_after)
    try:
        run.begin()
        while run.ladder.added < max_steps and run.may_add and run.step_on():
            pass
        run.end(whole)
    except KeyboardInterrupt:
        run.ladder.interrupted = True
    return run.told()


class _Stepwise:
    """The steps under way."""

    def __init__(
        self,
        twin: TwinModel,
        train: Sequence[Aligned],
        holdout: Sequence[Aligned],
        limit: TimeLimit,
        seed: int,
        say: Say,
        fitted_after: bool,
    ) -> None:
        self._first, self._train, self._holdout, self._seed, self._say = twin, train, holdout, seed, say
        self._limit, self._fitted_after = limit, fitted_after
        self.ladder = Ladder(twin, [self._step(None, {}, twin)])
        self._looks = PartLooks(train, holdout, seed, self._say, limit, self.ladder.refused)
        self._together = False

    @property
    def may_add(self) -> bool:
        """Whether there is time for an effect; for the first one there always is."""
        return self._may_fit or not self.ladder.added

    @property
    def _may_fit(self) -> bool:
        return self._fitted_after or not self._limit.over()

    def begin(self) -> None:
        """The first look, and what parameters alone would do."""
        self._look(None)
        self._at_first = dict(self._looks.said)
        if self._looks.may_look() and self.ladder.steps[0].verdict not in ("not_excited", "within_noise"):
            twin = self._first
            alone = twin.changed(twin.terms.with_parameters(refit_parameters(twin, self._train)))
            self.ladder.parameters_alone = (mean_error(alone, self._train), mean_error(alone, self._holdout))

    def step_on(self) -> bool:
        """One thing more: an effect, values fitted together, a look at what changed. False where nothing is left."""
        part, finding = self._looks.strongest()
        if finding is None:
            if not self._looks.may_look():
                return False
            if not self._looks.changed:
                # what did not hold beside values that are off may beside fitted ones, or something else
                return bool(self.ladder.refused) and not self.ladder.added and self._fitted_together()
            if len(self._looks.changed) == 1 or not self._fitted_together():
                self._look(set(self._looks.changed))
            return True
        self._say(f"adding {finding.effect} at {finding.target}")
        twin, step = self._with(finding, fitted=part == ROBOT) or (None, None)
        if twin is None or step is None:
            self.ladder.refused.append(finding.name)
            if part == ROBOT:
                self._look(None)
            return True
        joints = finding.joints
        errors = [mean_error(each, self._train, joints) for each in (self._first, self.ladder.twin, twin)]
        start, old, new = (np.nan if error is None else error for error in errors)
        halves, large = old - new > MOST_OF_IT * old, old - new >= REFINEMENT * start
        if self.ladder.added and not (halves and self.ladder.spares(joints)) and self._fitted_together():
            return True
        if self.ladder.added and not (halves or large):
            self.ladder.refused.append(finding.name)
            return True
        self.ladder.twin = twin
        self._looks.added(part, finding)
        self.ladder.steps.append(self._judged(step))
        if part == ROBOT or finding.target == HAND:
            self._look(None)
        return True

    def end(self, whole: Sequence[Aligned]) -> None:
        """What is left to look at, to fit together, to take back, or to fit to the whole recordings."""
        ladder = self.ladder
        if self._looks.changed:
            self._look(set(self._looks.changed))
        # values alone, where there was no time to find anything, or nothing held
        given = ladder.added or ladder.refused or self._looks.ended_early
        if self._may_fit and given and ladder.steps[-1].verdict == "unexplained":
            self._fitted_together()
        if self._worse_than_raw():
            ladder.take_back(self._first)
            self._looks.said = self._at_first
        if whole and any(step.together for step in ladder.steps):
            self._say("fitting the same values to the whole recordings")
            # from where it ended: another hollow is not what held-out motion has judged
            found = calibrate(ladder.twin, whole, (), load_space(_TOGETHER), "least-squares", seed=self._seed)
            ladder.twin, ladder.parameters = ladder.twin.changed(found.terms), found.parameters
            last = self._step(None, {}, ladder.twin, whole, ())
            ladder.steps.append(last.model_copy(update={"together": True, "verdict": ladder.steps[-1].verdict}))

    def told(self) -> Ladder:
        """The ladder with the reason for its verdict."""
        gravest, self.ladder.ended_early = self._looks.gravest, self._looks.ended_early
        if gravest is not None:
            self.ladder.reason = gravest.reason
        elif not self.ladder.interrupted:
            self.ladder.reason = _NOTHING_MOVES
        return self.ladder

    def _look(self, only: Collection[str] | None) -> None:
        """Diagnoses some parts again, or all."""
        self._looks.look(self.ladder.twin, only)
        self.ladder.steps[-1] = self._judged(self.ladder.steps[-1])

    def _judged(self, step: Step) -> Step:
        gravest = self._looks.gravest
        return step.model_copy(update={"verdict": gravest.verdict if gravest is not None else "not_excited"})

    # -- fits ----------------------------------------------------------------------------------------------

    def _with(self, finding: Finding, *, fitted: bool) -> tuple[TwinModel, Step] | None:
        """The twin with a finding, refitted to the end, or as it is `fitted`.

        None where it cannot stand beside the others or predicts worse.
        """
        twin, term = self.ladder.twin, finding.term
        try:
            if fitted:
                changed = with_finding(twin, finding)
            else:
                refit = self._looks.refit(twin, finding)
                if refit is None:
                    return None
                term = refit.terms[0]
                changed = twin.changed(twin.terms.with_effect(term).with_parameters(refit.parameters))
        except BadInput:
            return None
        values = {name: term.values[name] for name in finding.parameters}
        step = self._step(finding, values, changed)
        return (changed, step) if step.better_than(self.ladder.steps[-1]) else None

    def _fitted_together(self) -> bool:
        """Fits all values at once, the first time; whether held-out motion got better, and all was looked at anew."""
        if self._together:
            return False
        self._together = True
        self._say("fitting the values of all effects and parameters together")
        ladder, found = self.ladder, self._fit()
        changed = ladder.twin.changed(found.terms)
        step = self._step(None, {}, changed).model_copy(update={"together": True})
        better = step.better_than(ladder.steps[-1])
        if better:
            ladder.twin, ladder.parameters = changed, found.parameters
            ladder.steps.append(self._judged(step))
        if found.interrupted:
            raise KeyboardInterrupt
        if better:
            self._look(None)
        return better

    def _fit(self) -> Calibration:
        """All values fitted at once, the model's own from where the steps have left them and from where they were.

        What they have come to beside one effect may be a dead end beside all of them: the better on fitted motion
        counts. Where the time for looks is over there is one fit of few starts.
        """
        reached, effects = self.ladder.twin, self.ladder.twin.terms.effects
        search = "least-squares" if self._looks.ended_early else "multi-start"
        found: list[Calibration] = []
        for twin in (reached, reached.changed(self._first.terms.model_copy(update={"effects": effects}))):
            if not (found and (self._looks.ended_early or found[0].interrupted or twin.terms == reached.terms)):
                found.append(
                    calibrate(twin, self._train, self._holdout, load_space(_TOGETHER), search, seed=self._seed)
                )
        return replace(min(found, key=lambda one: one.after_rad2), interrupted=found[-1].interrupted)

    def _worse_than_raw(self) -> bool:
        """Whether held-out motion is predicted better by the command itself than by what the steps have come to."""
        if not self.ladder.added or not self._holdout:
            return False
        raw = raw_command_error(self.ladder.twin, self._holdout)
        reached = self.ladder.last_judged.holdout_mse_rad2
        return raw is not None and reached is not None and reached >= raw

    def _step(
        self,
        finding: Finding | None,
        values: dict[str, float],
        twin: TwinModel,
        train: Sequence[Aligned] | None = None,
        holdout: Sequence[Aligned] | None = None,
    ) -> Step:
        return Step(
            effect=finding.effect if finding else None,
            target=finding.target if finding else None,
            joints=finding.joints if finding else (),
            parameters=values,
            mse_rad2=_finite(mean_error(twin, self._train if train is None else train)),
            holdout_mse_rad2=_finite(mean_error(twin, self._holdout if holdout is None else holdout)),
            verdict=None,
            confusable_with=finding.confusable_with if finding else (),
        )


def _finite(value: float | None) -> float | None:
    return value if value is not None and np.isfinite(value) else None
