"""From an unexplained joint to the law that it lacks: ports and variables compete, the leading few are fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from twin_daemon.estimation.nuisances import carried_over, nuisance_variables
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.estimation.posterior import floor_and_corrections
from twin_daemon.estimation.thresholds import FLOOR_CHI_SQUARE
from twin_daemon.estimation.uncertainty import block_gain, block_samples, sample_squares
from twin_daemon.estimation.variables import OnsetVariable, Variable
from twin_daemon.estimation.windows import spread
from twin_daemon.executor import concurrently, in_order
from twin_daemon.processes import Say
from twin_daemon.processor_time import TimeLimit
from twin_daemon.proposals.descent import Linear, Reached, columns, cross_validated, folds, gauss_newton
from twin_daemon.proposals.features import OF_NEIGHBOURS, Feature, features
from twin_daemon.proposals.law_problem import GivenLaw, LawProblem
from twin_daemon.proposals.thresholds import (
    FINE_POSITIONS,
    LAW_STEP,
    LEADING,
    MOST_HELD_S,
    MOST_NEIGHBOURS,
    MOST_TRAIN_S,
    NUISANCE_REACH,
    NULL_DRAWS,
    PLAIN_SHARE,
    RACING,
    RACING_ROUNDS,
    ROUNDS,
    SMOOTHNESS,
    STEP_LENGTHS,
)
from twin_daemon.proposals.track import Track, track
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.submodel import Part
from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True)
class Trial:
    """One port and variable by one linear step: the share of the squared error that it takes from blocks it has not
    seen, and `reduction`, the share that roll-outs with it take from all, where a fit may `start` (p,)."""

    feature: Feature
    share: float
    reduction: float
    smoothness: float
    linear: Linear
    start: np.ndarray

    @property
    def promise(self) -> float:
        """The better of both: a law that is strong bends what one step says of it."""
        return max(self.share, self.reduction)

    @property
    def freedom(self) -> float:
        """How many values of the law the data determine."""
        own = len(self.start) - len(self.feature.knots)
        return _determined(self.linear.slopes[:, own:], self.linear.beliefs[:, own:])


@dataclass(frozen=True, eq=False)
class FittedLaw:
    """A law fitted in roll-outs, on its own motion and on held-out motion (errors in rad^2, over the part's joints)."""

    problem: LawProblem
    reached: Reached
    nats: float
    mse_before: float
    mse_after: float
    gain: float
    gain_ci95: tuple[float, float]
    trial: Trial

    @property
    def feature(self) -> Feature:
        assert self.problem.feature is not None
        return self.problem.feature

    @property
    def coefficients(self) -> np.ndarray:
        """(k,) in the feature's unit."""
        return self.problem.coefficients(self.reached.point[None])[0]

    @cached_property
    def sigmas(self) -> np.ndarray:
        """(k,) of the coefficients, the nuisances' own uncertainty among it, wider where the law leaves much."""
        inflation = max(1.0, self.chi_square)
        information = self.reached.slopes.T @ self.reached.slopes / inflation
        unit = np.sqrt(np.maximum(np.diag(np.linalg.pinv(information))[self.problem.own :], 0.0))
        return unit * 2.0 * self.feature.most

    @property
    def chi_square(self) -> float:
        return self.reached.cost / self.problem.effective_samples


@dataclass
class JointSearch:
    """The search for a law at one joint, within the smallest part that moves it, beside laws that are `given` there.

    Raises no error for a joint that has nothing to say: `reduced` is then None, and `why` says it.
    """

    twin: TwinModel
    reduction: Reduction
    part: Part
    joint: str
    train: Sequence[Aligned]
    holdout: Sequence[Aligned]
    given: tuple[GivenLaw, ...] = ()
    seed: int = 0
    say: Say = lambda _: None
    limit: TimeLimit = field(default_factory=TimeLimit)

    def __post_init__(self) -> None:
        moving = [name for name in self.reduction.moving if name in self.part.joints]
        self.reduced: Reduced | None = self.reduction.of(self.twin, self.part, moving) if moving else None
        if self.reduced is None:
            return
        small = self.reduced.twin
        self.pieces = spread(self.reduced.train, MOST_TRAIN_S)
        self.held = spread(self.reduced.holdout, MOST_HELD_S)
        self.variables = tuple(_believable(v) for v in nuisance_variables(small, self.pieces, self.reduced.joints))
        self.floor, self.corrections = floor_and_corrections(small, self.pieces, self.variables, self.reduced.joints)
        self.held_corrections = floor_and_corrections(small, self.held, (), self.reduced.joints)[1]
        drives = np.abs(small.drive[:, small.joints.index(self.joint)])
        self.actuator = int(np.argmax(drives)) if drives.size and drives.any() else None
        if self.actuator is None:
            return
        neighbours = self._neighbours()
        self.tracks = [
            track(small, self.twin, recording, self.joint, self.actuator, neighbours)
            for recording in (*self.train, *self.holdout)
        ]
        self.base = self.problem(None, 0.0)

    def _neighbours(self) -> list[str]:
        """Joints that move and stand next to this one: the nearest in the description's order."""
        moving = [name for name in self.reduction.moving if name != self.joint]
        order = self.twin.joints
        here = order.index(self.joint)
        return sorted(moving, key=lambda name: abs(order.index(name) - here))[:MOST_NEIGHBOURS]

    # -- the model alone -----------------------------------------------------------------------------------

    @cached_property
    def alone(self) -> Reached:
        """What is uncertain about the model anyway, fitted without any law but those that are given."""
        return gauss_newton(self.base, self.base.start, len(self.variables), ROUNDS)

    @property
    def times_floor(self) -> float:
        """What the model leaves of this joint, in floors, with everything uncertain as fitted."""
        assert self.reduced is not None
        return float(self.base.times_floor(self.alone.point)[self.reduced.joints.index(self.joint)])

    @property
    def within_floor(self) -> bool:
        return self.times_floor <= FLOOR_CHI_SQUARE

    @property
    def stiffness(self) -> float:
        """N m/rad of the joint's servo."""
        assert self.reduced is not None
        return float(self.reduced.twin.model.actuator_gainprm[self.actuator, 0])

    # -- ports and variables -------------------------------------------------------------------------------

    def trials(self, named: str = "") -> list[Trial]:
        """Every port and variable, or the features of one name, by one linear step each, the best first."""
        known = [one for one in self._features() if named in ("", one.name)]
        own = len(self.variables)
        temper = np.sqrt(max(1.0, self.alone.cost / self.base.effective_samples))
        nuisance_slopes = self.alone.slopes

        def tried(feature: Feature, say: Say) -> Trial:
            self.limit.check()
            problem = self.problem(feature, SMOOTHNESS[0])
            point = problem.point(self.alone.point, np.zeros(len(feature.knots)))
            rows, slopes = columns(problem, point, range(own, own + len(feature.knots)), LAW_STEP)
            fold = folds(problem)
            data = len(fold)
            whole = np.concatenate([nuisance_slopes[:data], slopes[:data]], axis=1)
            best: Trial | None = None
            for smoothness in (0.0,) if feature.memory else SMOOTHNESS:
                # what the model gets wrong altogether is no noise of the sensors: beliefs count as much more
                law = self.problem(feature, smoothness)
                believed, beliefs = law.prior_residuals(point[None])[0], law.prior_slopes()
                linear = Linear(rows[:data], whole, fold, temper * believed, temper * beliefs)
                share = cross_validated(linear, own)
                if best is None or share > best.share:
                    best = Trial(feature, share, 0.0, smoothness, linear, point)
            assert best is not None
            say(f"{feature.name}: {best.share:.0%} of the error by one linear step")
            return self._stepped(best)

        fine = [one for one in known if len(one.knots) == FINE_POSITIONS]
        trials = in_order(tried, [one for one in known if one not in fine], self.say)
        if not trials or max(trial.share for trial in trials) <= PLAIN_SHARE:  # else nothing finer is left
            trials += in_order(tried, fine, self.say)
        return sorted(trials, key=lambda trial: self.price(1.0 - trial.promise, trial.freedom))

    def _features(self) -> list[Feature]:
        """Every port and variable that the motion to fit can say something about."""
        tracks = self.tracks[: len(self.train)]
        seen = {name: np.concatenate([t.of(name) for t in tracks]) for name in Track.VARIABLES}
        neighbours = {
            (name, over): np.concatenate([t.of_neighbour(name, over) for t in tracks])
            for name in tracks[0].neighbours
            for over in OF_NEIGHBOURS
        }
        return features(self.stiffness, seen, neighbours)

    def reached(self, feature: Feature) -> tuple[float, float]:
        """The least and the largest that a law's variable was in any motion, that of validation among it."""
        if feature.neighbour:
            every = [t.of_neighbour(feature.neighbour, feature.over) for t in self.tracks]
        elif feature.over == "load":
            every = [self.stiffness * np.abs(t.error) for t in self.tracks]
        else:
            every = [t.of(feature.over) for t in self.tracks]
        return min(float(one.min()) for one in every), max(float(one.max()) for one in every)

    def _stepped(self, trial: Trial) -> Trial:
        """The trial with the best of some lengths of its linear step, as roll-outs show it."""
        problem = self.problem(trial.feature, trial.smoothness)
        own, linear = problem.own, trial.linear
        steps = [linear.step(linear.rows, len(trial.start))]
        # what stood in for the law may have gone far: once more with all of it back where it is believed to be
        back = np.zeros(len(trial.start))
        back[:own] = self.base.start - trial.start[:own]
        steps.append(back + linear.beside(linear.rows + linear.slopes @ back, own))
        lengths = [(length, step) for step in steps for length in STEP_LENGTHS]
        points = np.clip(np.array([trial.start + length * step for length, step in lengths]), 0.0, 1.0)
        costs = (problem.residuals(points) ** 2).sum(axis=1)
        best = int(np.argmin(costs))
        return replace(trial, start=points[best], reduction=1.0 - float(costs[best]) / self.alone.cost)

    def problem(
        self, feature: Feature | None, smoothness: float, *, held: bool = False, twin: TwinModel | None = None
    ) -> LawProblem:
        """The error of the twin, or of another one, with such a law, over the motion to fit or the held-out one.

        Without a feature it is that of the laws that are given, if any.
        """
        assert self.reduced is not None
        assert self.actuator is not None
        variables = self.variables
        if held:
            variables = tuple(v for v in variables if not isinstance(v, OnsetVariable))
        return LawProblem(
            twin or self.reduced.twin,
            self.held if held else self.pieces,
            variables,
            self.reduced.joints,
            self.floor,
            feature=feature,
            joint=self.joint,
            actuator=self.actuator,
            tracks=self.tracks,
            given=self.given,
            smoothness=smoothness,
            corrections=self.held_corrections if held else self.corrections,
            threads=1 if feature or self.given else None,
        )

    # -- shapes --------------------------------------------------------------------------------------------

    def leading(self, trials: Sequence[Trial]) -> list[FittedLaw]:
        """The best of sorted trials fitted in roll-outs beside the nuisances, validated on held-out motion, best first.

        Two rounds for those that promise most; those that then lead go on.
        """

        def begin(trial: Trial) -> tuple[Trial, LawProblem, Reached]:
            self.limit.check()
            problem = self.problem(trial.feature, trial.smoothness)
            return trial, problem, gauss_newton(problem, trial.start, problem.own, RACING_ROUNDS)

        def go_on(begun: tuple[Trial, LawProblem, Reached], say: Say) -> FittedLaw:
            self.limit.check()
            trial, problem, reached = begun
            law = self.judged(trial, problem, gauss_newton(problem, reached, problem.own, ROUNDS))
            say(f"{trial.feature.name}: {law.gain:.0%} of the held-out error")
            return law

        begun = concurrently(begin, trials[:RACING])
        best: dict[str, tuple[Trial, LawProblem, Reached]] = {}
        for one in sorted(begun, key=lambda one: self.price(one[2].cost, _freedom(one[1], one[2]))):
            best.setdefault(one[0].feature.name, one)  # of curves that are finer or coarser one goes on
        return sorted(in_order(go_on, list(best.values())[:LEADING], self.say), key=lambda law: -law.nats)

    @cached_property
    def samples(self) -> float:
        """How many independent samples the motion to fit is worth."""
        return max(self.base.effective_samples, 2.0)

    def price(self, left: float, values: float) -> float:
        """Of a law that leaves so much and has so many values, in twice a nat: lower is better."""
        return self.samples * float(np.log(max(left, 1e-9))) + values * float(np.log(self.samples))

    def judged(self, trial: Trial, problem: LawProblem, reached: Reached, *, freedom: float | None = None) -> FittedLaw:
        """The evidence of a law that has been fitted, and its gain on held-out motion; `freedom` are its values."""
        before, after = self._held_alone, self._held(problem, reached.point)
        total_before, total_after = float(before.mean()), float(after.mean())
        block = block_samples(self.held[0].time_s)
        values = _freedom(problem, reached) if freedom is None else freedom
        alone, with_law = (max(cost / self.samples, 1.0) for cost in (self.alone.cost, reached.cost))
        return FittedLaw(
            problem=problem,
            reached=reached,
            nats=0.5 * (self.price(alone, 0.0) - self.price(with_law, values)),
            mse_before=total_before,
            mse_after=total_after,
            gain=1.0 - total_after / max(total_before, 1e-30),
            gain_ci95=block_gain(before, after, block, self.seed),
            trial=trial,
        )

    @cached_property
    def _held_alone(self) -> np.ndarray:
        return self._held(None, self.alone.point)

    def _held(self, problem: LawProblem | None, point: np.ndarray, twin: TwinModel | None = None) -> np.ndarray:
        """(n,) rad^2: mean over the joints of each held-out sample's squared error."""
        assert self.reduced is not None
        kept, moved = carried_over(self.variables, point, self.held)
        feature, smoothness = (problem.feature, problem.smoothness) if problem else (None, 0.0)
        judge = self.problem(feature, smoothness, held=True, twin=twin).shifted(moved)
        at = np.concatenate([point[kept], point[len(self.variables) :]])
        residuals = [r[0] for r in judge.joint_residuals(at[None])]
        columns = [self.reduced.twin.joints.index(name) for name in self.reduced.joints]
        known = [np.isfinite(r.measured[:, columns]) for r in self.held]
        return sample_squares(residuals, known)

    def gain_of(self, changed: TwinModel) -> float:
        """What another twin of the part takes away of the held-out error, nothing fitted beside it."""
        before, after = (self._held(None, self.base.start, twin) for twin in (None, changed))
        return 1.0 - float(after.mean()) / max(float(before.mean()), 1e-30)

    def null_share(self, trial: Trial) -> float:
        """How often residuals that are moved in time, so that nothing depends on anything, fit as well as this."""
        random = np.random.default_rng(self.seed)
        rows, own = trial.linear.rows, len(self.variables)
        as_well = 0
        for _ in range(NULL_DRAWS):
            blocks = np.array_split(rows, max(4, len(rows) // 100))
            moved = np.concatenate([blocks[i] * random.choice((-1.0, 1.0)) for i in random.permutation(len(blocks))])
            as_well += cross_validated(trial.linear, own, moved) >= trial.share
        return (1 + as_well) / (1 + NULL_DRAWS)


def _believable(variable: Variable) -> Variable:
    """A nuisance within so many sigma of its prior: a friction of five times its value must not stand in for a law."""
    prior = variable.prior
    if prior is None:
        return variable
    low, high = prior.mean - NUISANCE_REACH * prior.sigma, prior.mean + NUISANCE_REACH * prior.sigma
    if variable.log:
        low, high = float(np.exp(low)), float(np.exp(high))
    return replace(variable, lower=max(low, variable.lower), upper=min(high, variable.upper))


def _freedom(problem: LawProblem, reached: Reached) -> float:
    """How many values the data determine of a law's, the smoothness taken off."""
    data = len(reached.rows) - len(problem.prior_slopes())
    return _determined(reached.slopes[:data, problem.own :], reached.slopes[data:, problem.own :])


def _determined(slopes: np.ndarray, beliefs: np.ndarray) -> float:
    """How many of k values data with slopes (m, k) determine beside beliefs with slopes (q, k)."""
    seen = slopes.T @ slopes
    return float(np.trace(np.linalg.pinv(seen + beliefs.T @ beliefs) @ seen))
