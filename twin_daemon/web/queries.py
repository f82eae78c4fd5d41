"""What the parts of a request say, read and checked."""

from __future__ import annotations

import math

from starlette.requests import Request

from twin_daemon.errors import BadInput


def number(request: Request, name: str, default: float) -> float:
    """A finite number. Raises BadInput."""
    text = request.query_params.get(name)
    if text is None:
        return default
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise BadInput(f"'{text:.40}' is no number", where=name)
    return value


def onset(request: Request) -> float | None:
    """s: when the commands begin, where the page says so."""
    return number(request, "onset_s", 0.0) if request.query_params.get("onset_s") else None


def lag(request: Request) -> float:
    """s by which what is predicted is moved to later times."""
    return 1e-3 * number(request, "lag_ms", 0.0)
