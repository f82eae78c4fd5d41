"""What a diagnosis says of each part of a robot, one after another or side by side, and again where a part changed."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from twin_daemon.diagnosis.refit import Refit, refit_effect
from twin_daemon.diagnosis.search import Search
from twin_daemon.diagnosis.verdict import Diagnosis, Finding, VerdictName
from twin_daemon.effects import LIBRARY
from twin_daemon.errors import BadInput
from twin_daemon.executor import places, side_by_side
from twin_daemon.places import ROBOT
from twin_daemon.processes import Say
from twin_daemon.processor_time import TimeLimit
from twin_daemon.simulation.alignment import Aligned, judged_joints
from twin_daemon.simulation.submodel import parts
from twin_daemon.simulation.twin import TwinModel

# What the whole hand is called when its parts differ: the first of these that any part is.
_GRAVEST: tuple[VerdictName, ...] = ("unexplained", "ambiguous", "explained", "within_noise", "not_excited")


class PartLooks:
    """What the last diagnosis `said` of each part, by name, of which some have `changed` since.

    What several parts share is said of the whole robot, and no part is searched before that is added.
    """

    def __init__(
        self,
        train: Sequence[Aligned],
        holdout: Sequence[Aligned],
        seed: int,
        say: Say,
        limit: TimeLimit,
        refused: Collection[str],
    ) -> None:
        self._train, self._holdout, self._seed, self._say, self._limit = train, holdout, seed, say, limit
        self._refused = refused  # names of findings that did not hold, as they are known
        self._refits: dict[str, Refit | None] = {}  # of findings that wait, by name
        self.said: dict[str, Diagnosis] = {}
        self.changed: set[str] = set()
        self.ended_early = False

    def may_look(self) -> bool:
        """Whether there is time for a look; where there is none, all of it has `ended_early`."""
        over = self._limit.over()
        self.ended_early |= over
        return not over

    def look(self, twin: TwinModel, only: Collection[str] | None = None) -> None:
        """Diagnoses some parts of a twin again, or all: what was found in one stays true while another one changes.

        All are looked at as one before each is searched. Raises KeyboardInterrupt where that was interrupted.
        """
        moving = judged_joints(twin, self._train)
        cut = {part.name: own for part in parts(twin) if (own := [n for n in part.joints if n in moving])}
        asked = [name for name in cut if only is None or name in only]
        whole = self._looked_at(twin, moving, self._say) if 1 < len(asked) == len(cut) else None
        self._refits.clear()
        if whole is not None and any(finding.name not in self._refused for finding in whole.findings):
            whole.search(0)
            self.said = {ROBOT: self._finished(whole.concluded())}
        else:
            # beside a cause that was refused each part is looked at as if there were none
            known = whole if whole and not whole.findings else None
            self._look_at_each(twin, {name: cut[name] for name in asked}, known)
            # in the hand's order, whichever ended first
            self.said = {name: self.said[name] for name in cut if name in self.said}
        self.changed.clear()

    def _looked_at(self, twin: TwinModel, joints: Sequence[str], say: Say) -> Search:
        """What some joints leave, and what they share."""
        search = Search(twin, self._train, self._holdout, joints, self._seed, say, self._limit)
        search.look()
        return search

    def _finished(self, found: Diagnosis) -> Diagnosis:
        if found.interrupted and self.may_look():
            raise KeyboardInterrupt
        return found

    def _look_at_each(self, twin: TwinModel, asked: Mapping[str, Sequence[str]], whole: Search | None) -> None:
        """Searches parts, given by name with their joints, side by side; what all leave is known of the `whole`."""
        names = list(asked)

        def searched(name: str, say: Say) -> Diagnosis | None:
            if not self.may_look() and (self.said or name != names[0]):
                return None
            search = whole.of(asked[name], say) if whole else self._looked_at(twin, asked[name], say)
            search.search(1)
            return search.concluded()

        if places(len(names)) > 1:
            self._say(f"looking at {', '.join(names)}: each is told of when it has ended")
        for index, found in side_by_side(searched, names, self._say):
            if found is not None:
                self.said[names[index]] = self._finished(found)
                self.changed.discard(names[index])

    def refit(self, twin: TwinModel, finding: Finding) -> Refit | None:
        """A finding refitted to the end; None where it cannot stand beside what the twin has.

        With it go those that wait at other parts, side by side: each part moves on its own.
        """
        if finding.name not in self._refits:
            waiting = {finding.name: finding}
            for said in self.said.values():
                other = self._strongest(said)
                if other is not None and other.name not in self._refits:
                    waiting.setdefault(other.name, other)
            names = list(waiting)

            def refitted(name: str, _: Say) -> Refit | None:
                effect, term = LIBRARY[waiting[name].effect], waiting[name].term
                try:
                    return refit_effect(twin, self._train, effect, [term.target], {}, start=term.values)
                except BadInput:
                    return None

            self._refits |= {names[index]: refit for index, refit in side_by_side(refitted, names, self._say)}
        return self._refits.pop(finding.name)

    def added(self, part: str, finding: Finding) -> None:
        """Says that a part has got what was found there."""
        self.said[part] = _with_its_finding(self.said[part], () if self.may_look() else finding.joints)
        self.changed.add(part)

    def strongest(self) -> tuple[str, Finding | None]:
        """The finding with the most evidence, and its part."""
        left = [(one.evidence_nats, name, one) for name, said in self.said.items() if (one := self._strongest(said))]
        return max(left, key=lambda item: item[:2])[1:] if left else ("", None)

    def _strongest(self, said: Diagnosis) -> Finding | None:
        left = [finding for finding in said.findings if finding.name not in self._refused]
        return max(left, key=lambda finding: finding.evidence_nats, default=None)

    @property
    def gravest(self) -> Diagnosis | None:
        """What was said of the part that is furthest from explained; None where nothing was."""
        return min(self.said.values(), key=lambda said: _GRAVEST.index(said.verdict), default=None)


def _with_its_finding(part: Diagnosis, joints: Collection[str]) -> Diagnosis:
    """What a diagnosis of a part said of it with one of its findings, until the part is looked at again.

    Where that will not be, as these are the finding's `joints`, what it found at other ones is all that there is.
    """
    left = tuple(other for other in part.findings if joints and not set(other.joints) & set(joints))
    settled = not left and part.verdict in ("explained", "ambiguous")
    return part.model_copy(update={"findings": left, "verdict": "within_noise" if settled else part.verdict})
