"""Splits a calibration into parts that do not touch each other, each on the smallest model that moves it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin_daemon.fitting.clear_parts import Reduction, restricted
from twin_daemon.fitting.knobs import Knob
from twin_daemon.fitting.problem import Problem
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.contacts import touching_parts
from twin_daemon.simulation.submodel import Part, parts, submodel, with_coupled
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel

_CONTACT_POSES = 60
_ONSET_REACH_S = 0.15  # what a drive's lag can be


@dataclass(frozen=True)
class SubProblem:
    """A problem over some of the knobs. `weight` is its share of the whole objective's joints."""

    problem: Problem
    weight: float

    def start(self, units: dict[str, float]) -> np.ndarray:
        """(p,) unit coordinates: what is already known by knob name, else the knobs' own start."""
        return self.problem.start_from(units)

    def restarted(self, units: dict[str, float]) -> Problem:
        """The same problem with what is already known as its start."""
        old = self.problem
        values = old.values(self.start(units))
        knobs = tuple(replace(k, start=float(v)) for k, v in zip(old.knobs, values, strict=True))
        return Problem(
            old.twin, old.recordings, knobs, old.objective, threads=old.threads, prior_weight=old.prior_weight
        )

    def added_to(self, terms: Terms, units: dict[str, float]) -> Terms:
        """The terms with what this problem's knobs turn, at a point."""
        parameters, effects, _ = self.problem.settings(self.start(units))
        turned = {w[1] for k in self.problem.knobs for w in k.writes if w[0] == "effect"}
        terms = terms.with_parameters(parameters)
        for term in effects or ():
            if f"{term.effect}:{term.target}" in turned:
                terms = terms.with_effect(term)
        return terms


def reduced_problems(
    twin: TwinModel,
    recordings: Sequence[Aligned],
    knobs: Sequence[Knob],
    objective: Sequence[str],
    *,
    separable: bool,
    free_onsets: bool = False,
    clear: bool = False,
    prior_weight: float = 0.0,
) -> list[SubProblem]:
    """One sub-problem for each part of the hand that the knobs leave independent; one in all where they do not.

    A trunk that moves is a part as well, and moves under each of the others as its commands say; what they do to it
    while they move is left out, as it is small beside what it carries. With `clear`, parts that touch each other are
    fitted to the time in which they touch nothing, and left out if they have too little of that: what a contact does
    hangs on surfaces that no model has right, and a free roll-out through one says more about chance than about values.

    With `free_onsets` each has a correction of its own to every onset that was estimated: it depends on the lag of its
    drives, and these are not known yet.
    """
    contacts = any(touching(twin, r) for r in recordings)
    onsets = [i for i, r in enumerate(recordings) if r.onset_free] if free_onsets else []
    found = parts(twin)
    groups = [(p, [k for k in knobs if set(k.joints) <= set(p.joints)]) for p in found]
    split = separable and sum(len(own) for _, own in groups) == len(knobs)
    shares = [_Share(p, own, [j for j in objective if j in p.joints], len(objective)) for p, own in groups]
    shares = [share for share in shares if share.knobs and share.joints]
    if split and contacts and clear and not any(r.onset_free for r in recordings):
        out = _clear_problems(twin, recordings, shares, prior_weight)
        if out:
            return out
    if contacts or not split:
        needed = set(objective) | {j for k in knobs for j in k.joints}
        chosen = [p for p in found if needed & set(p.joints)]
        members = {n for p in chosen for n in (*p.joints, *p.trunk)}
        keep = _needed(twin, recordings, members, needed)
        turned = [*knobs, *_onset_knobs(onsets, objective[0])]
        return [_sub(twin, recordings, turned, objective, keep, contacts, 1.0, prior_weight)]
    out = []
    for share in shares:
        needed = {*share.joints, *(j for k in share.knobs for j in k.joints)}
        keep = _needed(twin, recordings, {*share.part.joints, *share.part.trunk}, needed)
        turned = [*share.knobs, *_onset_knobs(onsets, share.joints[0])]
        out.append(_sub(twin, recordings, turned, share.joints, keep, contacts, share.weight, prior_weight))
    return out


@dataclass(frozen=True)
class _Share:
    """What a part has of a problem: its knobs, and its joints of an objective of so many."""

    part: Part
    knobs: list[Knob]
    joints: list[str]
    of: int

    @property
    def weight(self) -> float:
        return len(self.joints) / self.of


def _clear_problems(
    twin: TwinModel, recordings: Sequence[Aligned], shares: Sequence[_Share], prior_weight: float
) -> list[SubProblem]:
    """A sub-problem for each part that has enough time in which it touches nothing, over that time.

    Pieces of a recording know nothing of an onset that is estimated: there must be none.
    """
    reduction = Reduction(twin, recordings, [])
    out = []
    for share in shares:
        reduced = reduction.of(twin, share.part, share.joints)
        if reduced is not None:
            problem = Problem(reduced.twin, reduced.train, share.knobs, share.joints, prior_weight=prior_weight)
            out.append(SubProblem(problem, share.weight))
    return out


def _onset_knobs(recordings: Sequence[int], label: str) -> list[Knob]:
    """Corrections (s) of the onsets of some recordings, by their index; `label` tells problems apart."""
    reach = _ONSET_REACH_S
    return [Knob(f"{label}.onset.{i}", "s", -reach, reach, 0.0, False, writes=(("onset", str(i)),)) for i in recordings]


def _needed(twin: TwinModel, recordings: Sequence[Aligned], members: set[str], needed: set[str]) -> tuple[str, ...]:
    """Of some members, the joints that move, are fitted, or share an actuator with one that is; in the twin's order."""
    keep = {n for n in members if n in needed or any(r.moving[twin.joints.index(n)] for r in recordings)}
    return with_coupled(twin, keep)


def _sub(
    twin: TwinModel,
    recordings: Sequence[Aligned],
    knobs: Sequence[Knob],
    objective: Sequence[str],
    keep: tuple[str, ...],
    contacts: bool,
    weight: float,
    prior_weight: float,
) -> SubProblem:
    if contacts:
        return SubProblem(Problem(twin, recordings, knobs, objective, prior_weight=prior_weight), weight)
    small = submodel(twin, keep, recordings[0].start_position)
    cut = [restricted(r, small) for r in recordings]
    return SubProblem(Problem(small, cut, knobs, objective, prior_weight=prior_weight), weight)


def touching(twin: TwinModel, recording: Aligned) -> bool:
    """Whether the hand touches anything along the measured motion, by the model's own geometry."""
    rows = np.linspace(0, len(recording.states) - 1, _CONTACT_POSES).astype(int)
    poses = twin.measurement.invert(twin.joints, recording.states[rows])
    return bool(touching_parts(twin, parts(twin), poses))
