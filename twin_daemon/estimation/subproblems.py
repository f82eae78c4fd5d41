"""A calibration split into parts of the hand that do not touch each other, searched one after another.

Each is a problem on the smallest model that moves its part. From outside they are one search with one falling error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin_daemon.estimation.partition import Reduction, restricted
from twin_daemon.estimation.problem import Problem
from twin_daemon.estimation.thresholds import CONTACT_POSES, ONSET_REACH_S
from twin_daemon.estimation.variables import EffectVariable, OnsetVariable, Variable
from twin_daemon.simulation.alignment import Aligned, moving_joints
from twin_daemon.simulation.contacts import touching_parts
from twin_daemon.simulation.submodel import Part, drive_groups, is_of_body, parts, submodel, with_coupled
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True)
class SubProblem:
    """A problem over some of the variables. `weight` is its share of the whole objective's joints."""

    problem: Problem
    weight: float

    def start(self, units: dict[str, float]) -> np.ndarray:
        """(p,) unit coordinates: what is already known by variable name, else the variables' own start."""
        return self.problem.start_from(units)

    def restarted(self, units: dict[str, float]) -> Problem:
        """The same problem with what is already known as its start."""
        old = self.problem
        values = old.values(self.start(units))
        variables = tuple(replace(v, start=float(value)) for v, value in zip(old.variables, values, strict=True))
        return Problem(
            old.twin, old.recordings, variables, old.objective, threads=old.threads, prior_weight=old.prior_weight
        )

    def added_to(self, terms: Terms, units: dict[str, float]) -> Terms:
        """The terms with what this problem's variables set, at a point."""
        parameters, effects, _ = self.problem.settings(self.start(units))
        moved = {(v.effect, v.target) for v in self.problem.variables if isinstance(v, EffectVariable)}
        terms = terms.with_parameters(parameters)
        for term in effects or ():
            if (term.effect, term.target) in moved:
                terms = terms.with_effect(term)
        return terms


def reduced_problems(
    twin: TwinModel,
    recordings: Sequence[Aligned],
    variables: Sequence[Variable],
    objective: Sequence[str],
    *,
    separable: bool,
    free_onsets: bool = False,
    prior_weight: float = 0.0,
) -> list[SubProblem]:
    """One sub-problem for each part of the hand that the variables leave independent; one in all where they do not.

    A trunk that moves is a part as well, and moves under each of the others as its commands say; what they do to it
    while they move is left out, as it is small beside what it carries. Parts that touch each other are fitted to the
    time in which they touch nothing, and left out if they have too little of that: what a contact does
    hangs on surfaces that no model has right, and a free roll-out through one says more about chance than about values.

    With `free_onsets` each has a correction of its own to every onset that was estimated: it depends on the lag of its
    drives, and these are not known yet.
    """
    contacts = any(touching(twin, r) for r in recordings)
    onsets = [i for i, r in enumerate(recordings) if r.onset_free] if free_onsets else []
    found = parts(twin)
    shares, all_of_them = _shared_out(found, variables, objective)
    split = separable and all_of_them
    if split and contacts and not any(r.onset_free for r in recordings):
        out = _clear_problems(twin, recordings, shares, prior_weight)
        if out:
            return out
    if contacts or not split:
        needed = set(objective) | {j for v in variables for j in v.joints}
        chosen = [p for p in found if needed & set(p.joints)]
        members = {n for p in chosen for n in (*p.joints, *p.trunk)}
        keep = _needed(twin, recordings, members, needed)
        moved = [*variables, *_onset_variables(onsets, objective[0])]
        return [_sub(twin, recordings, moved, objective, keep, contacts, 1.0, prior_weight)]
    out = []
    for share in shares:
        needed = {*share.joints, *(j for v in share.variables for j in v.joints)}
        keep = _needed(twin, recordings, {*share.part.joints, *share.part.trunk}, needed)
        moved = [*share.variables, *_onset_variables(onsets, share.joints[0])]
        out.append(_sub(twin, recordings, moved, share.joints, keep, contacts, share.weight, prior_weight))
    return out


def group_problems(
    twin: TwinModel,
    recordings: Sequence[Aligned],
    variables: Sequence[Variable],
    objective: Sequence[str],
    *,
    prior_weight: float = 0.0,
) -> list[SubProblem]:
    """One sub-problem for each group of joints that one servo moves, while all others follow their measured motion.

    A roll-out of one costs a fraction of a chain's, and what is wrong at one joint does not bend what is fitted at the
    next. Empty where that is no smaller than the parts, where variables tie groups together, as a link's mass does that
    all joints before it carry, where one has too little motion that is clear of contacts, and where an onset is not
    known, of which pieces of a recording know nothing.
    """
    if _of_bodies(variables) or any(r.onset_free for r in recordings):
        return []
    shares, all_of_them = _shared_out(drive_groups(twin), variables, objective)
    larger, _ = _shared_out(parts(twin), variables, objective)
    if not all_of_them or len(shares) <= len(larger):
        return []
    found = _clear_problems(twin, recordings, shares, prior_weight)
    return found if len(found) == len(shares) else []


def _shared_out(
    found: Sequence[Part], variables: Sequence[Variable], objective: Sequence[str]
) -> tuple[list[_Share], bool]:
    """What each part has of a problem, where it has anything; whether every variable is one part's alone."""
    groups = [(p, [v for v in variables if set(v.joints) <= set(p.joints)]) for p in found]
    shares = [_Share(p, own, [j for j in objective if j in p.joints], len(objective)) for p, own in groups]
    every = sum(len(own) for _, own in groups) == len(variables)
    return [share for share in shares if share.variables and share.joints], every


@dataclass(frozen=True)
class _Share:
    """What a part has of a problem: its variables, and its joints of an objective of so many."""

    part: Part
    variables: list[Variable]
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
    reduction = Reduction(twin, recordings, [], bodies=_of_bodies([v for share in shares for v in share.variables]))
    out = []
    for share in shares:
        reduced = reduction.of(twin, share.part, share.joints, start_errors=False)
        if reduced is not None:
            problem = Problem(reduced.twin, reduced.train, share.variables, share.joints, prior_weight=prior_weight)
            out.append(SubProblem(problem, share.weight))
    return out


def _of_bodies(variables: Sequence[Variable]) -> bool:
    """Whether any of them changes a body's mass, inertia or centre of mass."""
    return any(is_of_body(name) for variable in variables for name in variable.parameters_moved)


def _onset_variables(recordings: Sequence[int], label: str) -> list[OnsetVariable]:
    """Corrections (s) of the onsets of some recordings, by their index; `label` tells problems apart."""
    reach = ONSET_REACH_S
    return [OnsetVariable(f"{label}.onset.{i}", "s", -reach, reach, 0.0, recordings=(i,)) for i in recordings]


def _needed(twin: TwinModel, recordings: Sequence[Aligned], members: set[str], needed: set[str]) -> tuple[str, ...]:
    """Of some members, the joints that move, are fitted, or share an actuator with one that is; in the twin's order."""
    keep = members & (needed | set(moving_joints(recordings)))
    return with_coupled(twin, keep)


def _sub(
    twin: TwinModel,
    recordings: Sequence[Aligned],
    variables: Sequence[Variable],
    objective: Sequence[str],
    keep: tuple[str, ...],
    contacts: bool,
    weight: float,
    prior_weight: float,
) -> SubProblem:
    if contacts:
        return SubProblem(Problem(twin, recordings, variables, objective, prior_weight=prior_weight), weight)
    small = submodel(twin, keep, recordings[0].start_position, bodies=_of_bodies(variables))
    cut = [restricted(r, small) for r in recordings]
    return SubProblem(Problem(small, cut, variables, objective, prior_weight=prior_weight), weight)


def touching(twin: TwinModel, recording: Aligned) -> bool:
    """Whether the hand touches anything along the measured motion, by the model's own geometry."""
    rows = np.linspace(0, len(recording.states) - 1, CONTACT_POSES).astype(int)
    poses = twin.measurement.invert(twin.joints, recording.states[rows])
    return bool(touching_parts(twin, parts(twin), poses))
