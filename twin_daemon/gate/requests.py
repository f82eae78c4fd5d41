"""What can be asked of the gate, as it comes over a network."""

from __future__ import annotations

import json
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from twin_daemon.gate.settings import LONGEST_LEASE_S

Verb = Literal["arm", "disarm", "move", "trajectory", "target", "stop", "release", "beat", "recalibrate"]
_Name = Annotated[str, Field(min_length=1, max_length=200)]
MOST_REASON = 500
_Reason = Annotated[str, Field(max_length=MOST_REASON)]
_Targets = Annotated[dict[_Name, float], Field(max_length=256)]
MAX_POINTS = 20_000


class _Request(BaseModel):
    """`session` is the gate's own name for its present life, `sequence` grows with every request of one sender and is
    no larger than the time in ns: an old request says nothing when it comes again. `stamp_ns` is when it was asked, by
    the sender's clock, `lease` what the reply to arm told: whoever arms commands, not others in the same name."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    session: str = Field(default="", max_length=64)
    sequence: int = Field(default=0, ge=0, lt=2**63)
    stamp_ns: int = Field(default=0, ge=0, lt=2**63)
    lease: str = Field(default="", max_length=64, repr=False)


class Arm(_Request):
    reason: _Reason = ""
    lease_s: float | None = Field(default=None, gt=0.0, le=LONGEST_LEASE_S, allow_inf_nan=False)


class Disarm(_Request):
    pass


class Beat(_Request):
    pass


class Recalibrate(_Request):
    pass


class Stop(_Request):
    reason: _Reason = ""


class Release(_Request):
    reason: _Reason = ""


class Target(_Request):
    """A streamed target, rad by joint or command. Numbers that are not finite are refused by the gate, not here."""

    targets: _Targets


class Move(_Request):
    targets: _Targets
    seconds: float | None = Field(default=None, gt=0.0, le=600.0, allow_inf_nan=False)
    dry_run: bool = False


class Follow(_Request):
    """A trajectory: `times_s` (w,) from 0, `positions` (w, j) rad of `joints`. `lead_s` is how long the way from where
    the hand is to the first position takes; without it the gate chooses."""

    name: str = Field(default="trajectory", max_length=200)
    joints: Annotated[list[_Name], Field(min_length=1, max_length=256)]
    times_s: Annotated[list[float], Field(min_length=1, max_length=MAX_POINTS)]
    positions: Annotated[list[list[float]], Field(min_length=1, max_length=MAX_POINTS)]
    lead_s: float | None = Field(default=None, gt=0.0, le=600.0, allow_inf_nan=False)
    dry_run: bool = False


Request = Arm | Disarm | Beat | Recalibrate | Stop | Release | Target | Move | Follow
KINDS: dict[str, type[Arm | Disarm | Beat | Recalibrate | Stop | Release | Target | Move | Follow]] = {
    "arm": Arm,
    "disarm": Disarm,
    "beat": Beat,
    "recalibrate": Recalibrate,
    "stop": Stop,
    "release": Release,
    "target": Target,
    "move": Move,
    "trajectory": Follow,
}
MAX_BYTES = 4 * 2**20
_MOST_OF_A_STOP = 20_000


class BadRequest(Exception):
    """A request that cannot be read. `str` says what and where."""


def read_request(verb: str, payload: bytes) -> Request:
    """The request of `verb` in JSON bytes. Raises BadRequest; for a stop never."""
    if verb == "stop":
        return _read_stop(payload)
    if len(payload) > MAX_BYTES:
        raise BadRequest(f"{len(payload)} bytes; at most {MAX_BYTES} are read")
    try:
        return KINDS[verb].model_validate_json(payload or b"{}")
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise BadRequest(f"{place}: {first['msg']}" if place else first["msg"]) from None
    except RecursionError:
        raise BadRequest("nested too deeply") from None


def _read_stop(payload: bytes) -> Stop:
    """A stop in any form: its reason where one can be found, cut to what is kept. What else stands there is ignored."""
    text = payload[:_MOST_OF_A_STOP].decode(errors="replace")
    try:
        told = json.loads(text)
    except (ValueError, RecursionError):
        told = text
    reason = told.get("reason", "") if isinstance(told, dict) else told
    return Stop(reason=" ".join(str("" if reason is None else reason).split())[:MOST_REASON])
