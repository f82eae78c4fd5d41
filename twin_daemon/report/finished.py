"""Results that `twin diagnose` and `twin ladder` have written, read back as far as a page shows them."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from twin_daemon.diagnosis.verdict import VerdictName
from twin_daemon.errors import BadInput

_MOST_BYTES = 64 * 1024 * 1024


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True, populate_by_name=True, allow_inf_nan=False)


Number = float | None


class Value(_Part):
    """A fitted value with its 95 % interval."""

    value: Number
    unit: str
    ci95: tuple[Number, Number]


class FindingRead(_Part):
    effect: str
    target: str
    joints: tuple[str, ...]
    parameters: dict[str, Value]
    evidence: Number
    holdout_mse_before: Number
    holdout_mse_after: Number
    holdout_gain: Number
    holdout_gain_ci95: tuple[Number, Number]
    confusable_with: tuple[str, ...]
    explanation: str


class TrialRead(_Part):
    effect: str
    target: str
    evidence: Number
    fit_mse_rad2: Number
    holdout_mse_rad2: Number
    lost_because: str


class WhereRead(_Part):
    joint: str
    condition: str
    rmse_rad: Number
    bias_rad: Number
    times_average: Number
    seconds: Number


class PartRead(_Part):
    joints: tuple[str, ...]
    times_floor: Number
    left_times_floor: Number
    quiet: bool


class MovedRead(_Part):
    parameter: str
    sigma: Number


class ExperimentRead(_Part):
    path: str
    trajectory: str
    expected_difference_rad: Number
    separates: tuple[str, ...]
    why: str


class DiagnosisRead(_Part):
    """What `twin diagnose --json` writes."""

    format: Literal[1] = Field(alias="schema")
    verdict: VerdictName
    reason: str
    findings: tuple[FindingRead, ...]
    tried: tuple[TrialRead, ...]
    where: tuple[WhereRead, ...]
    parts: dict[str, PartRead]
    moved_parameters: tuple[MovedRead, ...] = ()
    next_experiment: ExperimentRead | None = None
    notes: tuple[str, ...] = ()
    hand: str | None = None
    version: str | None = None
    seed: int | None = None


class StepRead(_Part):
    effect: str | None
    target: str | None
    parameters: dict[str, Number]
    mse_rad2: Number
    holdout_mse_rad2: Number
    verdict: VerdictName | None
    together: bool = False


class ReferenceRead(_Part):
    mse_rad2: Number = None
    holdout_mse_rad2: Number = None


class LadderRead(_Part):
    """What `twin ladder --json` writes."""

    format: Literal[1] = Field(alias="schema")
    hand: str
    verdict: VerdictName | None
    reason: str
    steps: tuple[StepRead, ...] = Field(min_length=1)
    refused: tuple[str, ...] = ()
    references: dict[str, ReferenceRead]
    noise_floor_rad2: Number
    parent: str | None = None
    version: str | None = None
    notes: tuple[str, ...] = ()
    seed: int | None = None


Read = TypeVar("Read", DiagnosisRead, LadderRead)


def read_result(path: Path, kind: type[Read], command: str) -> Read:
    """The result in a file that `command` wrote. Raises BadInput with the key that is wrong."""
    todo = f"Write it with {command} --json {path.name}"
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise BadInput("is too large for a result", where=path, todo=todo)
        content = path.read_bytes()
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror})", where=path, todo=todo) from None
    try:
        return kind.model_validate_json(content)
    except ValidationError as error:
        raise BadInput(f"not what {command} writes: {_first(error)}", where=path, todo=todo) from None


def _first(error: ValidationError) -> str:
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"])
    return f"{key}: {first['msg']}" if key else first["msg"]
