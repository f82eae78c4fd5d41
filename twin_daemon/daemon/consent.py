"""Consent to motion that the twin begins by itself: a person's name and an end, given at the machine.

It is a file in the state folder and nothing else: no request over a network gives it, prolongs it or takes it back.
"""

from __future__ import annotations

import contextlib
import os
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, ValidationError

from twin_daemon.errors import BadInput
from twin_daemon.files import make_folder, sync_folder, write_atomically

CONSENT = "consent.json"
LONGEST = timedelta(days=366)
_MOST_BYTES = 10_000


class Consent(BaseModel):
    """Who has consented, when, and until when. Times are UTC."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    schema_: Literal[1] = Field(1, alias="schema")
    person: Annotated[str, Field(min_length=1, max_length=200)]
    given: AwareDatetime
    until: AwareDatetime

    def in_words(self) -> str:
        return f"{self.person} has consented until {self.until:%d %B %Y, %H:%M} UTC"


class NoConsent(Exception):
    """Nobody has consented now. `str` says why, and what to do."""


def give(path: Path, person: str, until: datetime, now: datetime) -> Consent:
    """Writes a consent, in place of an earlier one. Raises BadInput for what cannot be one, OSError for the disk."""
    if not person.strip():
        raise BadInput("a consent needs a person's name", where="--name")
    if not now < until <= now + LONGEST:
        raise BadInput(
            f"a consent cannot end on {until:%Y-%m-%d}", where="--until", allowed="a day within the next 366"
        )
    consent = Consent(schema=1, person=person.strip()[:200], given=now, until=until)
    make_folder(path.parent)
    write_atomically(path, consent.model_dump_json(by_alias=True).encode(), mode=0o644)
    return consent


def withdraw(path: Path) -> bool:
    """Takes it back; whether there was one. Gone from the disk when this returns. Raises OSError."""
    with contextlib.suppress(FileNotFoundError):
        path.unlink()
        sync_folder(path.parent)
        return True
    return False


def standing(path: Path, now: datetime) -> Consent:
    """The consent that holds now. Raises NoConsent; one that cannot be read is none."""
    todo = "'twin consent give' at the machine"
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK)
        with os.fdopen(handle, "rb") as file:
            consent = Consent.model_validate_json(file.read(_MOST_BYTES))
    except FileNotFoundError:
        raise NoConsent(f"nobody has consented to motion that begins by itself: {todo}") from None
    except OSError as error:
        raise NoConsent(f"the consent in {path} cannot be read ({error.strerror}): {todo}") from None
    except ValidationError:
        raise NoConsent(f"{path} is no consent: {todo}") from None
    if not consent.given <= now + timedelta(days=1) or consent.until > consent.given + LONGEST + timedelta(days=1):
        raise NoConsent(f"the times of the consent in {path} cannot be: {todo}")
    if now >= consent.until:
        raise NoConsent(f"the consent of {consent.person} ended on {consent.until:%d %B %Y, %H:%M} UTC: {todo}")
    return consent


def end_of(day: str) -> datetime:
    """The end of a day written as YYYY-MM-DD, UTC. Raises BadInput."""
    try:
        return datetime.strptime(day, "%Y-%m-%d").replace(tzinfo=UTC) + timedelta(days=1)
    except ValueError:
        raise BadInput(f"'{day}' is no date", where="--until", allowed="YYYY-MM-DD") from None
