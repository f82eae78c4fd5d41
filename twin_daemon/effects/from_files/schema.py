"""What an effect file says, and how it is read: numbers, names and words, no code and no paths."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import yaml
from pydantic import AllowInfNan, BaseModel, ConfigDict, Field, StringConstraints, ValidationError, model_validator

from twin_daemon.errors import BadInput
from twin_daemon.files import make_folder, write_atomically
from twin_daemon.resources import state_dir
from twin_daemon.yaml_files import load_yaml

SUFFIX = ".effect.yaml"
MAX_BYTES = 64_000
MAX_KNOTS = 512

STEEPEST_READING = 0.9  # of the true angle: a reading that turns back has no inverse

Finite = Annotated[float, AllowInfNan(False), Field(ge=-1e6, le=1e6)]
Word = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_.\- ]{0,80}$")]
Text = Annotated[str, StringConstraints(max_length=1000)]
Key = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]{2,63}$")]
Over = Literal[
    "position", "velocity", "acceleration", "load", "time", "heat", "command", "command_rate", "error", "neighbour",
    "neighbour_velocity", "orientation",
]  # fmt: skip


class EffectFile(BaseModel):
    """One law: where it acts, what it depends on, its curve, and what the data said of it.

    `knots` (k,) are in the unit of the variable, rad, rad/s, s or 1; with a `memory` they are widths of play in rad,
    times in s, or rates of a command in rad/s. `values` (k,) and `sigmas` (k,) are in `unit`. Between the knots it is
    linear, beyond them flat.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)

    format: Literal[1] = Field(default=1, alias="schema")
    name: Key
    title: Text
    story: Text = ""
    port: Literal["torque", "command", "reading"]
    over: Over
    factor: Literal["", "direction", "error", "velocity"] = ""
    memory: Literal["", "play", "relaxation", "creep", "lag", "slew"] = ""
    neighbour: Word = ""
    unit: Literal["N m", "N m/rad", "N m s/rad", "rad", "1"]
    knots: tuple[Finite, ...] = Field(min_length=1, max_length=MAX_KNOTS)
    values: tuple[Finite, ...] = Field(min_length=1, max_length=MAX_KNOTS)
    sigmas: tuple[Finite, ...] = Field(default=(), max_length=MAX_KNOTS)
    visited: tuple[Finite, Finite]
    formula: Text = ""
    formula_values: dict[Word, tuple[Finite, Finite, Finite]] = Field(default={}, max_length=8)
    found_at: Word = ""
    evidence: dict[Word, Finite] = Field(default={}, max_length=16)
    recordings: tuple[Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")], ...] = Field(
        default=(), max_length=64
    )

    @model_validator(mode="after")
    def _is_a_curve(self) -> Self:
        if len(self.knots) != len(self.values) or len(self.sigmas) not in (0, len(self.knots)):
            raise ValueError("knots, values and sigmas must be equally many")
        if len(self.values) < 2 and not self.memory:
            raise ValueError("a curve has two knots at least")
        if any(later <= earlier for earlier, later in zip(self.knots, self.knots[1:], strict=False)):
            raise ValueError("knots must increase")
        if self.over.startswith("neighbour") != bool(self.neighbour):
            raise ValueError("a neighbour has a name, and nothing else has")
        if self.memory and self.knots[0] <= 0.0:
            raise ValueError("widths and times of a memory must be positive")
        if self.port == "reading":
            if self.over == "position" and steepest(self.knots, self.values) > STEEPEST_READING:
                raise ValueError(f"a reading's slope beside the angle's own may be {STEEPEST_READING:g} at most")
            if self.over not in ("position", "neighbour", "time") or self.factor or self.memory:
                raise ValueError("a reading depends on the joint's angle, a neighbour's, or the time")
        return self


def steepest(knots: Sequence[float] | np.ndarray, values: Sequence[float] | np.ndarray) -> float:
    """The largest slope of a curve with values (k,) at knots (k,), of either sign."""
    return float(np.abs(np.diff(values) / np.diff(knots)).max())


def folder() -> Path:
    """Where effect files are: a folder of the state folder."""
    return state_dir() / "effects"


def load_effect_file(path: Path) -> EffectFile:
    """Reads one file. Raises BadInput with the first thing that is wrong."""
    todo = "Mend it, or move it away"
    try:
        if path.stat().st_size > MAX_BYTES:
            raise BadInput("is too large for an effect", where=path, allowed=f"up to {MAX_BYTES} bytes", todo=todo)
        raw: Any = load_yaml(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        told = " ".join(str(error).split())[:200]
        raise BadInput(f"cannot be read as an effect: {told}", where=path, todo=todo) from None
    try:
        found = EffectFile.model_validate(raw)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])[:80] or "(top)"
        told = " ".join(first["msg"].split())[:200]
        raise BadInput(f"is no effect: {key}: {told}", where=path, todo=todo) from None
    if f"{found.name}{SUFFIX}" != path.name:
        raise BadInput(
            f"says that its name is '{found.name}'", where=path, allowed=f"{found.name}{SUFFIX}", todo="Rename one"
        )
    return found


def save_effect_file(effect: EffectFile) -> Path:
    """Writes it into the state folder, whole or not at all."""
    make_folder(folder())
    path = folder() / f"{effect.name}{SUFFIX}"
    content = effect.model_dump(by_alias=True, mode="json")
    write_atomically(path, yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=110).encode())
    return path
