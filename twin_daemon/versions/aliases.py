"""Names that move: `current`, `previous` and `candidate` point at versions, which themselves never change."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from twin_daemon.errors import BadInput
from twin_daemon.files import write_atomically

CURRENT, PREVIOUS, CANDIDATE = "current", "previous", "candidate"
KEPT_PROMOTIONS = 100


class Aliases(BaseModel):
    """Where the names point. `promoted` is a stack of ids: the last is current, the one below it previous."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)

    format: Literal[1] = Field(default=1, alias="schema")
    promoted: tuple[str, ...] = ()
    names: dict[str, str] = {}

    def as_dict(self) -> dict[str, str]:
        """Every name that points somewhere, with its id."""
        moving = dict(zip((CURRENT, PREVIOUS), reversed(self.promoted), strict=False))
        return {**moving, **self.names}

    def promote(self, version_id: str) -> Aliases:
        """`version_id` becomes current and what was current becomes previous."""
        if self.promoted[-1:] == (version_id,):
            return self
        return self.model_copy(update={"promoted": (*self.promoted, version_id)[-KEPT_PROMOTIONS:]})

    def roll_back(self) -> Aliases:
        """What was previous becomes current again."""
        return self.model_copy(update={"promoted": self.promoted[:-1]})

    def name(self, alias: str, version_id: str) -> Aliases:
        """Any other name."""
        return self.model_copy(update={"names": {**self.names, alias: version_id}})


def read_aliases(path: Path) -> Aliases:
    """The names in a file; none if there is no file. Raises BadInput if the file is damaged."""
    try:
        return Aliases.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return Aliases()
    except ValidationError:
        raise BadInput(
            "the names of versions cannot be read",
            where=path,
            todo="The versions themselves are safe: delete this file and run 'twin versions promote ID' again",
        ) from None


def write_aliases(path: Path, aliases: Aliases) -> None:
    """Replace the file as a whole."""
    write_atomically(path, (json.dumps(aliases.model_dump(by_alias=True), indent=2) + "\n").encode())
