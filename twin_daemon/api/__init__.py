"""The twin from Python: `import twin_daemon as td`, and what the commands do as functions.

Every function returns what its command writes with --json, as attributes, with `.table()` for people and `.figure()` as
a Plotly figure. Angles in rad, times in s, errors as mean squares in rad^2; a number that nobody knows is None. What
cannot be used raises `twin_daemon.errors.BadInput`, which says what, where, what is allowed and what to do.
"""

from __future__ import annotations

from twin_daemon.api.fitting import add, calibrate, check, compare
from twin_daemon.api.inputs import Recording, Robot, hand, recording
from twin_daemon.api.learning import diagnose, ladder, versions
from twin_daemon.api.results import Addition, Calibration, Check, Comparison, Diagnosis, Ladder, Result, Versions

__all__ = [
    "Addition",
    "Calibration",
    "Check",
    "Comparison",
    "Diagnosis",
    "Ladder",
    "Recording",
    "Result",
    "Robot",
    "Versions",
    "add",
    "calibrate",
    "check",
    "compare",
    "diagnose",
    "hand",
    "ladder",
    "recording",
    "versions",
]
