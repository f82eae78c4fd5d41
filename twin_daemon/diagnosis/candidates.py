"""The candidates of one part: every effect at every place where it can act."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin_daemon.diagnosis.thresholds import COUNTED_NEARBY, LEAST_ALONG, TAKEN_AWAY, WIDER
from twin_daemon.effects import LIBRARY
from twin_daemon.effects.base import Effect, Parameter, Seen
from twin_daemon.estimation.variables import EffectVariable, effect_variable
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.prescribed import response_time_s
from twin_daemon.simulation.terms import EffectTerm
from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True)
class Hypothesis:
    """One effect at one place with the values to start from."""

    effect: Effect
    target: str
    starts: tuple[dict[str, float], ...]
    bounds: Mapping[str, tuple[float, float]]
    """Where each parameter is looked for here, in its unit."""

    @property
    def name(self) -> str:
        return f"{self.effect.key}:{self.target}"

    def contains(self, other: Hypothesis) -> bool:
        """Whether the other law, at the same place, is this one at a bound."""
        return self.target == other.target and other.effect.key in self.effect.contains

    def is_limit_of(self, other: Hypothesis) -> bool:
        """Whether the other law, at the same place, becomes this one at a bound of its own."""
        return self.target == other.target and other.effect.key in self.effect.limit_of

    def term(self, values: Mapping[str, float]) -> EffectTerm:
        return EffectTerm(effect=self.effect.key, target=self.target, values=dict(values))

    def variables(self, start: Mapping[str, float]) -> tuple[EffectVariable, ...]:
        """The effect's parameters as variables that start at these values, in a box of the size of its starts."""
        complete = self.effect.complete(start)
        variables = []
        for p in self.effect.parameters:
            if p.fixed or p.name == self.effect.everywhere:
                continue  # at one joint the latter says what another parameter says
            if p.refines and complete[p.name] == p.neutral:
                continue  # nobody has asked for it yet
            lower, upper = self._box(p)
            if p.held:
                lower = max(lower, complete[p.name] / COUNTED_NEARBY)
                upper = min(upper, complete[p.name] * COUNTED_NEARBY)
            if lower < upper:
                variables.append(effect_variable(self.effect.key, self.target, p, (lower, upper), complete[p.name]))
        return tuple(variables)

    def _box(self, p: Parameter) -> tuple[float, float]:
        values = [start[p.name] for start in self.starts]
        lower, upper = self.bounds[p.name]
        if p.refines:
            return lower, upper
        if p.log and lower > 0:
            return max(lower, min(values) / WIDER), min(upper, max(values) * WIDER)
        above = max(max(v - p.neutral for v in values), 0.0) * WIDER
        # a model's own friction can be taken away once, not thirty times
        below = max(max(p.neutral - v for v in values), 0.0) * (TAKEN_AWAY if self.effect.competes_with else WIDER)
        return max(lower, p.neutral - below), min(upper, p.neutral + above)

    def along(self, start: Mapping[str, float], amount: float) -> dict[str, float]:
        """The values this far along the line from neutral to a start; places and logarithmic parameters stay."""
        amount = max(amount, LEAST_ALONG)
        values = {}
        for p in self.effect.parameters:
            far = start[p.name]
            moved = far if p.log or p.held or p.fixed or p.place else p.neutral + amount * (far - p.neutral)
            values[p.name] = moved
        return self.clipped(values)

    def sensible(self) -> bool:
        """Whether the effect has anything to fit here."""
        return bool(self.starts) and bool(self.variables(self.starts[0]))

    def speaks_for(self, twin: TwinModel) -> set[str]:
        """Names of the nuisances that this candidate itself moves."""
        kind = self.effect.competes_with
        return set() if kind is None else {f"{self.target}.{kind}"}

    def freed(self, twin: TwinModel, scales: Mapping[str, float]) -> list[dict[str, float]]:
        """Starts that go on from where a nuisance has been standing in for the candidate, at these factors.

        A factor on a servo takes along what the servo drives, so that its starts count from there.
        """
        first = self.effect.parameters[0]
        found = []
        for name in self.speaks_for(twin):
            factor = scales.get(name, 1.0)
            if first.neutral == 1.0:
                others = [(start | {first.name: start[first.name] * factor}) for start in self.starts]
                begun = [self.effect.as_factor(factor), *others]
            else:
                added = (factor - 1.0) * twin.parameter(name).read(twin.base_model)
                begun = [{**self.effect.as_nominal, first.name: added}]
            found += begun
        return list(self.starting(found).starts)

    def holds_offset(self) -> set[str]:
        """Joints whose reading's offset this candidate speaks for."""
        return {self.target} if self.effect.stands_for == "offset" else set()

    def clipped(self, values: Mapping[str, float]) -> dict[str, float]:
        """The values within the bounds here: starts are scaled to the place, and a strong servo scales far."""
        return {name: float(np.clip(value, *self.bounds[name])) for name, value in values.items()}

    def starting(self, starts: Iterable[Mapping[str, float]]) -> Hypothesis:
        """The same candidate with other starts, within the bounds."""
        return replace(self, starts=tuple(self.effect.complete(self.clipped(start)) for start in starts))


def hypotheses(twin: TwinModel, joints: Sequence[str], *, whole_hand: bool) -> list[Hypothesis]:
    """All effects at the given joints and their servos, without those that the twin already has."""
    driving = [a for a, driven in zip(twin.actuators, twin.driven, strict=True) if set(driven) & set(joints)]
    targets: list[str] = list(joints)
    targets += [command for command in driving if command not in targets]
    targets += ["hand"] if whole_hand else []
    present = {(t.effect, LIBRARY[t.effect].acts_at(twin.place(t.target))) for t in twin.terms.effects}
    found = []
    for effect in tuple(LIBRARY.values()):
        for place in effect.distinct(map(twin.place, targets)):
            if (effect.key, effect.acts_at(place)) in present:
                continue
            hypothesis = candidate(effect, place.target, twin, joints[0])
            if hypothesis.sensible():
                found.append(hypothesis)
    return found


def candidate(effect: Effect, target: str, twin: TwinModel, joint: str) -> Hypothesis:
    """An effect at a place with its usual starts; `joint` stands for the whole hand."""
    scale = twin.scale(joint if target == "hand" else target)
    return Hypothesis(effect, target, (), effect.bounds(scale)).starting(effect.starts(scale))


def informed(
    hypothesis: Hypothesis,
    twin: TwinModel,
    recordings: Sequence[Aligned],
    joints: Sequence[str],
    gaps: Sequence[np.ndarray],
) -> Hypothesis:
    """A candidate with the starts that the error without it suggests; with its own where that says nothing.

    `gaps` are (n, k) rad a recording: measured minus predicted of `joints`.
    """
    concerned = [joint for joint in twin.joints_of(hypothesis.target) if joint in joints]
    if not concerned:
        return hypothesis
    columns = [twin.joints.index(joint) for joint in concerned]
    own = [list(joints).index(joint) for joint in concerned]
    within_s = max(response_time_s(twin, joint) for joint in concerned)
    found = []
    for recording, gap in zip(recordings, gaps, strict=True):
        angle = recording.measured[:, columns].sum(axis=1)
        known = np.isfinite(angle)
        if known.sum() > 1:
            speed = _speed(recording.time_s[known], angle[known], within_s)
            found.append((angle[known], speed, gap[known][:, own].sum(axis=1), recording.time_s[known]))
    if not found:
        return hypothesis
    seen = Seen(*(np.concatenate(one) for one in zip(*found, strict=True)))
    starts = hypothesis.effect.suggested(twin.scale(hypothesis.target), seen)
    return hypothesis.starting(starts) if starts else hypothesis


def _speed(time_s: np.ndarray, angle: np.ndarray, within_s: float) -> np.ndarray:
    """(n,) rad/s by differences over the time that the servo takes to follow: faster changes are noise."""
    reach = max(1, round(0.5 * within_s / float(np.median(np.diff(time_s)))))
    index = np.arange(len(time_s))
    first, last = np.maximum(index - reach, 0), np.minimum(index + reach, len(time_s) - 1)
    return (angle[last] - angle[first]) / np.maximum(time_s[last] - time_s[first], 1e-9)
