"""Immutable versions of a twin, and the names that move between them."""

from __future__ import annotations

from twin_daemon.callable_packages import make_callable

from .content_store import Stored
from .diff import ParameterChange, VersionDiff, diff
from .standing import Worse
from .store import Note, Proposed, VersionStore
from .version import NOMINAL, Draft, ParameterRecord, PosteriorRecord, RecordingUsed, Version, promised_rad2, seal

__all__ = [
    "NOMINAL",
    "Draft",
    "Note",
    "ParameterChange",
    "ParameterRecord",
    "PosteriorRecord",
    "Proposed",
    "RecordingUsed",
    "Stored",
    "Version",
    "VersionDiff",
    "VersionStore",
    "Worse",
    "diff",
    "promised_rad2",
    "seal",
]

make_callable(__name__)
