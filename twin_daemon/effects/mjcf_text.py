"""An MjSpec as text that compiles to the same numbers.

MuJoCo writes six digits unless it is told otherwise, and a model read back would then drift from the one that was
written. The setting is not part of its documented interface; without it the text has the six digits.
"""

from __future__ import annotations

import contextlib
import ctypes
import re
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

_LONG_NUMBER = re.compile(r'(?<=[" ])-?\d+(?:\.\d{7,})(?:e[-+]?\d+)?(?=[" ])|(?<=[" ])-?\d\.\d+e[-+]?\d+(?=[" ])')
_ONE_AT_A_TIME = threading.Lock()  # the setting is one for the process
_ALL_DIGITS = 17


def mjcf_text(spec: Any) -> str:
    """The MJCF of a compiled spec, every number with as many digits as it takes and no more."""
    with _ONE_AT_A_TIME, _precision(_ALL_DIGITS):
        return _LONG_NUMBER.sub(lambda match: _shortest(match.group()), spec.to_xml())


def _shortest(text: str) -> str:
    value = float(text)
    single = f"{value:.7g}"  # colours and the like are single precision
    if float(np.float32(value)) == value and np.float32(single) == np.float32(value):
        return single
    return repr(value)


@contextlib.contextmanager
def _precision(digits: int) -> Iterator[None]:
    library = _library()
    if library is None:
        yield
        return
    before = library._mjPRIVATE__get_xml_precision()
    library._mjPRIVATE__set_xml_precision(digits)
    try:
        yield
    finally:
        library._mjPRIVATE__set_xml_precision(before)


def _library() -> Any:
    for path in Path(mujoco.__file__).parent.glob("*mujoco*"):
        if path.suffix in (".dll", ".dylib") or ".so" in path.suffixes:
            try:
                library = ctypes.CDLL(str(path))
                return library if library._mjPRIVATE__get_xml_precision else None
            except (OSError, AttributeError):
                continue
    return None
