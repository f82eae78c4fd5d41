"""Errors that people can act on, with the exit codes that scripts rely on.

Every error is one line: what happened, where, what is allowed, what to do next.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path


class TwinError(Exception):
    """Base of all errors that are meant for people. `exit_code` is what the command ends with."""

    exit_code = 1

    def __init__(
        self,
        what: str,
        *,
        where: str | Path | None = None,
        allowed: str | None = None,
        todo: str | None = None,
    ) -> None:
        self.what = what
        self.where = None if where is None else str(where)
        self.allowed = allowed
        self.todo = todo
        super().__init__(self.line())

    def line(self) -> str:
        """The whole error as a single line (no line breaks, whatever the cause said)."""
        parts = [f"{self.where}: {self.what}" if self.where else self.what]
        if self.allowed:
            parts.append(f"Allowed: {self.allowed}")
        if self.todo:
            parts.append(self.todo)
        text = " ".join(_sentence(part) for part in parts)
        return " ".join(text.split())


def _sentence(part: str) -> str:
    text = part.strip().rstrip(".")
    return text if text.endswith(("?", "!")) else f"{text}."


class UsageError(TwinError):
    """The command was called in a way that cannot mean anything."""

    exit_code = 2


class BadInput(TwinError):
    """A file, name or value given by the user cannot be used. Nothing has been stored."""

    exit_code = 3


class Refused(TwinError):
    """The safety gate refused a command; the hand did not get it."""

    exit_code = 4


class NoAnswer(TwinError):
    """Nobody answered on the network in time."""

    exit_code = 5


def nearest(name: str, known: Iterable[str]) -> str:
    """A hint for a mistyped name: " Did you mean 'x'?", or the known names where none is near."""
    names = list(known)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    if close:
        return f"Did you mean '{close[0]}'?"
    shown = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
    return f"Known: {shown}" if names else "None are known"
