"""`twin add --finding`: what a diagnosis has found goes into the twin as it is, values, intervals and all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from twin_daemon.diagnosis.verdict import Diagnosis, Finding
from twin_daemon.errors import BadInput
from twin_daemon.workflows.session import Session


@dataclass(frozen=True)
class Taken:
    """A finding, the diagnosis that has it, and the file that they were read from."""

    finding: Finding
    found: Diagnosis
    path: Path

    @property
    def version(self) -> str | None:
        """The version that was diagnosed; None where that was given by its terms alone."""
        from twin_daemon.versions import NOMINAL

        return self.found.version or (None if self.found.terms is None or self.found.terms.effects else NOMINAL)

    def wanted(
        self,
        effect: str | None,
        joints: Sequence[str] | None,
        fitted: Sequence[Path] | None,
        held: Sequence[Path] | None,
        session: Session,
    ) -> tuple[str, list[str], list[Path], list[Path]]:
        """(effect, its places, recordings, held-out recordings) of the finding. Raises BadInput as `agree`."""
        self.agree(effect, joints, session)
        return self.finding.effect, [self.finding.target], self.recordings(fitted), self.holdouts(held)

    def agree(self, effect: str | None, joints: Sequence[str] | None, session: Session) -> None:
        """Raises BadInput where it is asked for something that the diagnosis did not find, or for another twin."""
        asked = {session.twin.place(name).target for name in joints or ()}
        if (effect or self.finding.effect) != self.finding.effect or (asked and asked != {self.finding.target}):
            raise BadInput(
                f"the finding is {self.finding.effect} at {self.finding.target}",
                where=self.path,
                todo="Leave EFFECT and --joint out, or name another finding as FILE:N",
            )
        if self.found.hand != session.hand.name:
            raise BadInput(f"is a diagnosis of {self.found.hand}, not of {session.hand.name}", where=self.path)
        if self.found.terms != session.twin.terms:
            raise BadInput(
                "is a diagnosis of another twin: its values hold beside the terms that were diagnosed",
                where=self.path,
                todo="Name that version with --version, or diagnose this one",
            )

    def recordings(self, given: Sequence[Path] | None) -> list[Path]:
        """Where the recordings are that the finding was fitted to: as given, else where they were."""
        return list(given or [Path(one.path) for one in self.found.fitted_on])

    def holdouts(self, given: Sequence[Path] | None) -> list[Path]:
        """The same for those that it was validated on; none where these were cut out of the others."""
        return list(given or [Path(one.path) for one in self.found.held_out_on])

    def verify(self, fitted: Sequence[str], held: Sequence[str] | None) -> None:
        """Raises BadInput for recordings other than the diagnosis's, by their sha256: what is said of them would be
        of data that the values do not come from. `held` is None where none were given."""
        for used, seen, option in (
            (self.found.fitted_on, fitted, "--recording"),
            (self.found.held_out_on, held or (), "--holdout"),
        ):
            if {one.sha256 for one in used} != set(seen):
                names = ", ".join(one.name for one in used) or "none"
                raise BadInput(
                    f"these are not the recordings of the diagnosis ({option}: {names})",
                    where=self.path,
                    todo="Give those, diagnose these, or leave --finding out to fit anew",
                )


def read_finding(text: str) -> Taken:
    """What `FILE` or `FILE:N` names: the Nth finding of a diagnosis, the first where no number stands."""
    from twin_daemon.report.finished import read_result

    name, _, number = text.rpartition(":")
    path, rank = (Path(name), int(number)) if name and number.isdecimal() else (Path(text), 1)
    found = read_result(path, Diagnosis, "twin diagnose")
    if not 1 <= rank <= len(found.findings):
        count = len(found.findings)
        raise BadInput(
            f"has no finding {rank}", where=path, allowed=f"1 to {count}" if count else "it has none: nothing was found"
        )
    if found.terms is None or not found.fitted_on:
        raise BadInput("does not say which twin and recordings were diagnosed", where=path, todo="Diagnose them again")
    return Taken(found.findings[rank - 1], found, path)
