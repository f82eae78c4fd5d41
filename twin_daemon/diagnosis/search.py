"""The diagnosis: part by part, from the residual to a named cause, or to the plain word that there is none."""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

from twin_daemon.diagnosis.as_fitted import as_fitted, closer, links_uncertain
from twin_daemon.diagnosis.common_delay import common_delay
from twin_daemon.diagnosis.conclude import Outcome, conclude, nothing_moves
from twin_daemon.diagnosis.everywhere import at_all, behind_all, in_common, of_all, said_once, with_everywhere
from twin_daemon.diagnosis.far_off import plainly_above
from twin_daemon.diagnosis.floor_check import above_floor
from twin_daemon.diagnosis.group import at_nominal, look
from twin_daemon.diagnosis.left_out import LeftOut
from twin_daemon.diagnosis.near import when_near
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.part_search import begun_outcome
from twin_daemon.diagnosis.shared import Shared
from twin_daemon.diagnosis.thresholds import MOST_EFFECTS
from twin_daemon.diagnosis.unit_search import UnitSearch, units
from twin_daemon.diagnosis.verdict import Diagnosis, Finding
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.executor import concurrently
from twin_daemon.places import ROBOT
from twin_daemon.processes import Say
from twin_daemon.processor_time import OutOfTime, TimeLimit
from twin_daemon.simulation.alignment import Aligned, judged_joints, unanswering_joints
from twin_daemon.simulation.submodel import Part, drive_groups
from twin_daemon.simulation.terms import EffectTerm
from twin_daemon.simulation.twin import TwinModel


def diagnose(
    twin: TwinModel,
    train: Sequence[Aligned],
    holdout: Sequence[Aligned],
    *,
    joints: Sequence[str] | None = None,
    seed: int = 0,
    stream: Say | None = None,
    most_effects: int = MOST_EFFECTS,
    limit: TimeLimit | None = None,
) -> Diagnosis:
    """Which physical effects the twin lacks, on the evidence of `train`, validated by `holdout`.

    Ctrl-C and the end of the time limit end the search; what has been found until then is in the answer.
    """
    search = Search(twin, train, holdout, joints, seed, stream or (lambda _: None), limit or TimeLimit())
    search.look()
    search.search(most_effects)
    return search.concluded()


class Search:
    """A diagnosis under way: first a look at all groups of joints and what they share, then a search at each.

    `findings` are the causes that several groups share, as they are found.
    """

    def __init__(
        self,
        twin: TwinModel,
        train: Sequence[Aligned],
        holdout: Sequence[Aligned],
        joints: Sequence[str] | None,
        seed: int,
        say: Say,
        limit: TimeLimit,
    ) -> None:
        self._twin, self._train, self._holdout = twin, train, holdout
        self._seed, self._say, self._limit = seed, say, limit
        self._asked = joints
        self._moving = [name for name in judged_joints(twin, train) if not joints or name in joints]
        self.findings: list[Finding] = []
        self._interrupted = False
        self._causes: list[Mapping[str, float]] = []
        self._outcomes: list[Outcome] = []
        self._left_out = LeftOut(unanswering=[name for name in unanswering_joints(twin, train) if name in self._moving])
        self._groups: list[Reduced] = []
        self._looked_at: list[tuple[Reduced, PartFit]] = []
        self._elsewhere: list[tuple[Reduced, PartFit]] = []  # of all that was looked at what is not asked any more
        self._above: list[tuple[Reduced, PartFit]] = []
        self._count = 0  # of all groups that can be seen
        self._begins: EffectTerm | None = None  # of several effects of groups that are searched together
        self._late: frozenset[str] = frozenset()

    @contextlib.contextmanager
    def _interruptible(self) -> Iterator[None]:
        try:
            yield
        except (KeyboardInterrupt, OutOfTime):
            self._interrupted = True

    def look(self) -> None:
        """What each group leaves with all that is uncertain about it fitted, and the causes that several share."""
        if not self._moving:
            return
        with self._interruptible(), contextlib.ExitStack() as stack:
            self._reduction = Reduction(self._twin, self._train, self._holdout)
            unseen, shared = self._first_look()
            stack.enter_context(self._limit.enforced())  # what a first look says is said however long it takes
            known = self._above_floor()
            if shared is None and sum(plainly_above(one) for _, one in self._above) > 1:
                shared = self._behind_all()
            if shared is None and self._begins is None:
                shared = in_common(self._twin, self._reduction, list(known.values()), self._seed, self._say)
            if not self._above and shared is None:
                self._look_near(unseen)
            while shared is not None:
                shared = self._beside(shared)

    def _first_look(self) -> tuple[list[tuple[Part, list[str]]], Shared | None]:
        """(the groups that touch something all the time, a cause of all joints that is as clear as that)."""
        chosen = [(g, own) for g in drive_groups(self._twin) if (own := [n for n in self._moving if n in g.joints])]
        cut = self._reduction.each(self._twin, chosen)
        self._groups = [reduced for reduced in cut if reduced is not None]
        unseen = [one for one, reduced in zip(chosen, cut, strict=True) if reduced is None]
        self._left_out.touching = {group.name: tuple(own) for group, own in unseen}
        self._left_out.cut(self._reduction, self._groups)
        self._looked_at = begun = concurrently(at_nominal, self._groups)
        self._count = len(begun)
        with self._limit.enforced():
            shared = of_all(self._twin, self._reduction, begun, self._seed, self._say)
        self._looked_at = [] if shared else concurrently(_looked_at, begun)
        return unseen, shared

    def _above_floor(self) -> dict[tuple[str, ...], tuple[Reduced, PartFit]]:
        """Which groups are above the floor, looked at closer; all groups by their joints, as they were seen best."""
        twin, looked_at = self._twin, self._looked_at
        late = common_delay([part for _, part in looked_at if part.within_floor])
        if late is not None:
            self._reduction = self._reduction.delayed(late.by_recording)
        behind = [one for one in looked_at if late is not None and one[1] in late.late]
        others = [one for one in looked_at if one not in behind]
        feel_each_other = links_uncertain(twin) or self._reduction.carries
        anew = feel_each_other and any(not part.within_floor for _, part in others)
        self._late = frozenset(joint for _, part in behind for joint in part.joints)
        self._above = behind + above_floor(others, self._outcomes, self._seed, self._say, anew=anew)
        known = {part.joints: (reduced, part) for reduced, part in looked_at}
        if self._above and (behind or feel_each_other):
            self._reduction, again = closer(twin, self._reduction, looked_at, self._above)
            known |= {part.joints: (reduced, part) for reduced, part in again}
            self._above = above_floor(again, self._outcomes, self._seed, self._say, late=self._late)
        else:
            self._above = [look(reduced) if part.nominal else (reduced, part) for reduced, part in self._above]
        return known

    def _behind_all(self) -> Shared | None:
        """One cause behind all groups above the floor."""
        found, self._begins = behind_all(self._twin, self._reduction, self._above, self._count, self._seed, self._say)
        return found

    def _look_near(self, unseen: Sequence[tuple[Part, Sequence[str]]]) -> None:
        """The motion near something else, where all that is clear of any is at its floor."""
        self._reduction, self._above, seen = when_near(
            self._twin, self._reduction, self._looked_at, unseen, self._outcomes, self._seed, self._say
        )
        self._groups += seen
        for group in seen:
            self._left_out.touching.pop(group.name, None)
        self._left_out.cut(self._reduction, self._groups)
        self._left_out.near = [reduced.name for reduced, _ in self._above]

    def _beside(self, shared: Shared) -> Shared | None:
        """Takes a shared cause into what is known; a further one beside it, which some may feel as well."""
        apart = {joint for _, part in shared.looked_at for joint in part.joints}.isdisjoint
        self._outcomes = [outcome for outcome in self._outcomes if apart(outcome.joints)]
        for reduced, part in shared.settled:
            self._outcomes.append(replace(begun_outcome(reduced, part), within_floor=True))
        self._groups = [group for group in self._groups if apart(group.joints)]
        self._found(shared)  # it is found, whatever time is left for who else has it
        finding, above = at_all(shared.finding, self._groups, self._outcomes, self._seed, self._say)
        self.findings[-len(shared.findings)] = finding
        everywhere = finding.target == ROBOT
        # of what some carry the others feel nothing, and are above the floor as before
        self._above = shared.forced + above if everywhere else [one for one in self._above if apart(one[1].joints)]
        if not (everywhere or self._above):
            return None
        # beside what all have some may have something of their own, which several feel
        self._twin = self._twin.changed(shared.terms)
        self._looked_at = [*shared.settled, *self._above]
        self._above_anew()
        if not everywhere:
            return None
        self._groups = [with_everywhere(group, finding) for group in self._groups]
        return self._behind_all() if len(self._above) > 1 else None

    def _found(self, shared: Shared) -> None:
        self.findings += shared.findings
        self._causes += shared.posteriors

    def _above_anew(self) -> None:
        """The groups above the floor once more, with what the twin now has."""
        self._reduction, again = closer(self._twin, self._reduction, self._looked_at, self._above)
        self._above = above_floor(again, self._outcomes, self._seed, self._say)

    def of(self, joints: Collection[str], say: Say) -> Search:
        """What some of the joints alone have said, to be searched by itself."""
        one = copy.copy(self)
        one._say = say
        apart = set(joints).isdisjoint
        one._groups = [group for group in self._groups if not apart(group.joints)]
        one._above = [(reduced, part) for reduced, part in self._above if not apart(part.joints)]
        one._outcomes = [outcome for outcome in self._outcomes if not apart(outcome.joints)]
        one._looked_at = [(reduced, part) for reduced, part in self._looked_at if not apart(part.joints)]
        one._elsewhere = [(reduced, part) for reduced, part in self._looked_at if apart(part.joints)]
        one._left_out = self._left_out.of(joints, [group.name for group in one._groups])
        one.findings, one._causes = list(self.findings), list(self._causes)
        return one

    def search(self, most_effects: int) -> None:
        """Looks for effects at the groups above the floor, so many at each that feel each other."""
        if self._interrupted or not self._moving:
            return
        with self._interruptible(), self._limit.enforced():
            search = self._unit_search(most_effects)
            if not (self.findings or self._begins):
                beside, self._begins = search.behind_the_others(self._above, self._count)
                if beside is not None:
                    self._found(beside)
                    # alone: what the worst one has of its own is searched again beside it
                    for finding in beside.findings:
                        self._twin = self._twin.changed(self._twin.terms.with_effect(finding.term))
                    self._above_anew()
                    self._looked_at = [*self._looked_at, *self._above]
                    search = self._unit_search(most_effects)
            for unit in units(self._twin, self._above):
                if unit := search.still_above(unit):
                    search.search(unit, self._begins)
            if not self.findings and (once := said_once(self._groups, self._outcomes, self._seed, self._say)):
                finding, self._outcomes = once
                self.findings.append(finding)
                self._causes.append({finding.name: finding.probability or 0.0})

    def _unit_search(self, most_effects: int) -> UnitSearch:
        return UnitSearch(
            self._twin,
            self._reduction,
            as_fitted(self._twin, [*self._elsewhere, *self._looked_at]),
            self._seed,
            self._say,
            most_effects,
            self._outcomes,
            self._left_out.touching,
            self._late,
        )

    def concluded(self) -> Diagnosis:
        """What all that was looked at comes to."""
        if not self._moving:
            return nothing_moves(self._asked)
        outcomes = list(self._outcomes)
        judged = {joint for outcome in outcomes for joint in outcome.joints}
        left = [(reduced, part, False) for reduced, part in self._above]
        if self._interrupted:
            # time may have been over before it was known which of these are above the floor on other motion as well
            known = {part.joints for _, part in self._above}
            left += [(r, part, part.within_floor) for r, part in self._looked_at if part.joints not in known]
        for reduced, part, sound in left:
            if not judged & set(reduced.joints):
                outcomes.append(replace(begun_outcome(reduced, part), unfinished=True, within_floor=sound))
        interrupted = self._interrupted or any(outcome.unfinished for outcome in outcomes)
        return conclude(self._twin, self._train, outcomes, self._left_out, interrupted, self.findings, self._causes)


def _looked_at(begun: tuple[Reduced, PartFit]) -> tuple[Reduced, PartFit]:
    """A group with what is uncertain about it fitted, unless it is at the floor of its sensors as it is."""
    return begun if begun[1].plainly_sound else look(*begun)
