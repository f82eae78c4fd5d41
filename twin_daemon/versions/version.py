"""What a version is: the terms of a twin, where its numbers came from, and how good they were found to be."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

import twin_daemon
from twin_daemon.comparison.region import Region
from twin_daemon.jsonable import canonical, plain

VERSION_SCHEMA = 1  # of version.json: what `Version` reads, written into each one
NOMINAL = "nominal"  # the id of the version that sets nothing: the model as the hand's description has it


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, populate_by_name=True)


class ParameterRecord(_Strict):
    """One fitted number with what is known of it. Bounds and interval are in `unit`."""

    value: float | None
    unit: str = ""
    lower: float | None = None
    upper: float | None = None
    at_bound: bool = False
    ci95: tuple[float, float] | None = Field(default=None, description="95 % interval; null where none is known")
    identifiable: bool | str | None = None


class RecordingUsed(_Strict):
    """A recording by the name it had and by its bytes."""

    name: str
    sha256: str


class PosteriorRecord(_Strict):
    """What is known of a version's values together: means and covariance in the values' units.

    `not_excited` are those that its own recordings say nothing of: what was known of them before stands there.
    """

    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    means: tuple[float, ...] = ()
    covariance: tuple[tuple[float, ...], ...] = ()
    not_excited: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _shapes(self) -> PosteriorRecord:
        count = len(self.names)
        sizes = {len(self.units), len(self.means), len(self.covariance), *map(len, self.covariance)}
        if sizes != ({count} if count else {0}):
            raise ValueError("names, units, means and covariance differ in length")
        return self


def promised_rad2(errors: Mapping[str, Any] | None) -> float | None:
    """Mean squared error that a version's `errors` promise: on motion that it had not seen, else on what it was fitted
    to. None where it was never judged.
    """
    for name in ("holdout_after", "after"):
        value = ((errors or {}).get(name) or {}).get("mse_rad2")
        if value is not None:
            return float(value)
    return None


class Draft(_Strict):
    """A version that is not stored yet: everything but its identity. JSON values only; NaN is refused."""

    hand: str
    kind: str = Field(pattern=r"^[a-z][a-z_]*$", description="nominal, calibrated, effect_added, ...")
    terms: dict[str, Any] = Field(description="parameters, effects, measurement: what the simulation layer reads back")
    parent: str | None = Field(default=None, description="id of the version that this one was made from")
    title: str = ""
    note: str = ""
    parameters: dict[str, ParameterRecord] = {}
    posterior: PosteriorRecord | None = Field(
        default=None, description="how sure it is of its values, together; null in versions of before"
    )
    fitted_on: tuple[RecordingUsed, ...] = ()
    held_out_on: tuple[RecordingUsed, ...] = ()
    errors: dict[str, Any] = Field(
        default={},
        description="before, after, holdout_before, holdout_after: {mse_rad2}, each one free roll-out over `joints`; "
        "given, holdout_given: of the version that this was made from, where the search began elsewhere",
    )
    region: Region | None = Field(
        default=None,
        description="what each joint went through in the recordings of its fits: position, speed and load; null where "
        "nothing was fitted, and unknown in versions of before",
    )
    search: dict[str, Any] | None = None
    seed: int | None = None

    def mse_rad2(self, name: str) -> float | None:
        """One of the mean squared errors in rad^2; None where it is not known."""
        value = self.errors.get(name)
        mse = value.get("mse_rad2") if isinstance(value, dict) else None
        return None if mse is None else float(mse)

    @property
    def better_on_held_out(self) -> bool | None:
        """Whether it predicts held-out motion better than what it was made from; None where nothing was held out."""
        after = self.mse_rad2("holdout_after")
        before = [e for e in map(self.mse_rad2, ("holdout_before", "holdout_given")) if e is not None]
        return None if after is None or not before else after < min(before)

    def sets(self) -> dict[str, Any]:
        """What the terms set: parameters by name, values of effects as effect:target.value."""
        found = dict(self.terms.get("parameters") or {})
        for effect in self.terms.get("effects") or []:
            place = f"{effect.get('effect')}:{effect.get('target')}"
            found |= {f"{place}.{name}": value for name, value in (effect.get("values") or {}).items()}
        return found


class Version(Draft):
    """A version. `id` is the SHA-256 of everything else but `created`: it cannot change and keep its name.

    The nominal one is not stored: its id is its name, and it is what the hand's description is at the moment.
    """

    format: Literal[1] = Field(default=VERSION_SCHEMA, alias="schema")
    id: str = Field(pattern=rf"^([0-9a-f]{{64}}|{NOMINAL})$")
    created: str | None = Field(description="UTC, ISO 8601; null for the nominal one, which nobody made")
    mjcf_sha256: str | None = Field(description="null for the nominal one, whose model the description names")
    program: dict[str, str] = Field(description="program versions that made it")

    def as_json(self) -> dict[str, Any]:
        """A plain object that `Version.model_validate` reads back."""
        return self.model_dump(by_alias=True, mode="json")

    def content_id(self) -> str:
        """The id that this content must bear."""
        return content_id(self.as_json())

    @property
    def short_id(self) -> str:
        return self.id[:12]


def nominal(hand: str) -> Version:
    """The version of a hand that sets nothing."""
    return Version(
        hand=hand,
        kind=NOMINAL,
        title="the model as described",
        terms={"schema": 1, "parameters": {}, "effects": []},
        id=NOMINAL,
        created=None,
        mjcf_sha256=None,
        program=program_versions(),
    )


def content_id(content: dict[str, Any]) -> str:
    """The id of a version as its file spells it, so that fields which came later do not change it."""
    named = {key: value for key, value in content.items() if key not in ("id", "created")}
    return hashlib.sha256(canonical(named)).hexdigest()


def seal(draft: Draft, mjcf: str, made: datetime | None = None) -> Version:
    """Give a draft its identity together with the MJCF that it compiles to. `made` (UTC) is now by default."""
    finite = Draft.model_validate(_finite(draft.model_dump(mode="python"), where=draft.kind))
    unnamed = Version(
        **finite.model_dump(),
        id="0" * 64,
        created=(made or datetime.now(UTC)).isoformat(timespec="microseconds"),
        mjcf_sha256=hashlib.sha256(mjcf.encode()).hexdigest(),
        program=program_versions(),
    )
    return unnamed.model_copy(update={"id": unnamed.content_id()})


@cache
def program_versions() -> dict[str, str]:
    """What computed the numbers, so that a difference between two versions can be traced to it."""
    return {
        "twin_daemon": twin_daemon.__version__,
        "mujoco": metadata.version("mujoco"),
        "numpy": metadata.version("numpy"),
        "python": platform.python_version(),
    }


def _finite(value: Any, where: str) -> Any:
    """Plain JSON values. An undefined number in a version would be stored for good, so it is an error here."""
    if isinstance(value, dict):
        return {str(key): _finite(item, f"{where}.{key}") for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item, f"{where}[{i}]") for i, item in enumerate(value)]
    if hasattr(value, "tolist"):  # numpy
        return _finite(value.tolist(), where)
    result = plain(value)
    if result is None and value is not None:
        raise ValueError(f"{where} is {value}: a version holds finite numbers, or None for unknown")
    return result
