"""Immutable versions of a twin, and the names that move between them."""

from __future__ import annotations

from .diff import ParameterChange, VersionDiff, diff
from .shelf import Stored
from .store import Note, VersionStore
from .version import Draft, ParameterRecord, RecordingUsed, Version, seal

__all__ = [
    "Draft",
    "Note",
    "ParameterChange",
    "ParameterRecord",
    "RecordingUsed",
    "Stored",
    "Version",
    "VersionDiff",
    "VersionStore",
    "diff",
    "seal",
]
