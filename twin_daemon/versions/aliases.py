"""Names that move: `current`, `previous` and `candidate` point at versions, which themselves never change."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from twin_daemon.errors import BadInput
from twin_daemon.files import write_atomically
from twin_daemon.versions.decisions import LAYOUT, Decision, refuse_newer
from twin_daemon.versions.version import NOMINAL

CURRENT, PREVIOUS, CANDIDATE = "current", "previous", "candidate"
KEPT_PROMOTIONS = 100


class Aliases(BaseModel):
    """Where the names point after the decision number `sequence`.

    `promoted` is a stack of ids: the last is current, the one below it previous, and the nominal model lies under all.
    The candidate is what was stored as such last and nobody decided about.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)

    format: Literal[2] = Field(default=LAYOUT, alias="schema")
    sequence: int = 0
    promoted: tuple[str, ...] = ()
    names: dict[str, str] = {}

    def as_dict(self) -> dict[str, str]:
        """Every name that points somewhere, with its id."""
        moving = dict(zip((CURRENT, PREVIOUS), reversed((NOMINAL, *self.promoted)), strict=False))
        return {**moving, **self.names}

    def after(self, decision: Decision) -> Aliases:
        """The names as they are once a decision is made."""
        changed: dict[str, Any] = {"sequence": decision.sequence}
        match decision.what:
            case "stored" | "named" if decision.name and decision.version:
                changed["names"] = {**self.names, decision.name: decision.version}
            case "promoted" if decision.version:
                if self.promoted[-1:] != (decision.version,):
                    changed["promoted"] = (*self.promoted, decision.version)[-KEPT_PROMOTIONS:]
                changed["names"] = self._without_candidate(decision.version)
            case "rolled_back":
                changed["promoted"] = self.promoted[:-1]
            case "rejected" if decision.version:
                changed["names"] = self._without_candidate(decision.version)
            case "unnamed":
                changed["names"] = {name: target for name, target in self.names.items() if name != decision.name}
            case "pruned":
                gone = {*decision.removed, *decision.stubbed}
                changed["promoted"] = tuple(version for version in self.promoted if version not in gone)
            case "checkpoint":
                changed |= {"promoted": decision.promoted, "names": decision.names}
        return self.model_copy(update=changed)

    def _without_candidate(self, version_id: str) -> dict[str, str]:
        return {name: target for name, target in self.names.items() if (name, target) != (CANDIDATE, version_id)}


class DamagedNames(BadInput):
    """The file of names cannot be read."""


def read_aliases(path: Path) -> Aliases | None:
    """The names in a file; None if there is no file. Raises DamagedNames, or BadInput for a newer release's."""
    try:
        content = json.loads(path.read_bytes())
        refuse_newer(content.get("schema"), LAYOUT, path)
        return Aliases.model_validate(_migrated(content))
    except FileNotFoundError:
        return None
    except (ValueError, AttributeError, ValidationError):
        raise DamagedNames(
            "the names of versions cannot be read",
            where=path,
            todo="The versions themselves are safe: delete this file and run 'twin versions promote ID' again",
        ) from None


def _migrated(content: dict[str, Any]) -> dict[str, Any]:
    """From layout 1, which kept no decisions and let `candidate` stay on a version that had been promoted."""
    if content.get("schema") != 1:
        return content
    promoted = content.get("promoted") or []
    names = {k: v for k, v in (content.get("names") or {}).items() if k != CANDIDATE or v not in promoted}
    return {**content, "schema": LAYOUT, "sequence": 0, "promoted": promoted, "names": names}


def write_aliases(path: Path, aliases: Aliases) -> None:
    """Replace the file as a whole."""
    write_atomically(path, (json.dumps(aliases.model_dump(by_alias=True), indent=2) + "\n").encode())
