"""What acts on a hand beside wear, such as its temperature, read from a file and asked for by time."""

from __future__ import annotations

import csv
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from twin_daemon.errors import BadInput

_AROUND_S = 86_400.0  # a look at the hand may be so long before the first or after the last line


def read_covariate(path: Path) -> Callable[[datetime], float]:
    """The values of a CSV file with a heading and two columns, a time (ISO 8601, UTC without a zone; or seconds
    since 1970) and a number, as a function of time: straight lines between them. Raises BadInput."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = [row for row in csv.reader(file) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadInput(f"{path}: {error}", where="--covariate") from None
    read: list[tuple[float, float]] = []
    for number, row in enumerate(rows[1:], start=2):
        try:
            read.append((_seconds(row[0]), float(row[1])))
        except (ValueError, IndexError):
            raise BadInput(
                f"'{','.join(row)[:80]}' is no time with a number",
                where=f"{path}, line {number}",
                allowed="2026-11-12T08:00:00,21.5 or seconds since 1970 in the place of the date",
            ) from None
    if len(read) < 2:
        raise BadInput(f"{path} has fewer than two values", allowed="a heading, then a time and a number a line")
    times, values = np.array(sorted(read)).T
    if not np.isfinite(values).all():
        raise BadInput(f"{path} has values that are no numbers", todo="Leave those lines out")

    def at(when: datetime) -> float:
        second = when.timestamp()
        if not times[0] - _AROUND_S <= second <= times[-1] + _AROUND_S:
            first, last = (datetime.fromtimestamp(t, UTC).date() for t in (times[0], times[-1]))
            raise BadInput(
                f"{path} says nothing of {when.date()}",
                where="--covariate",
                allowed=f"versions of {first} to {last}",
                todo="Give a file that covers the whole history",
            )
        return float(np.interp(second, times, values))

    return at


def _seconds(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        found = datetime.fromisoformat(text.strip())
        return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()
