"""What acts on a hand beside wear, such as its temperature, read from a file and asked for by time."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from twin_daemon.errors import BadInput

_AROUND_S = 86_400.0  # a look at the hand may be so long before the first or after the last line


@dataclass(frozen=True, eq=False)
class Covariate:
    """Values by time (s since 1970), of one file, with straight lines between them."""

    path: Path
    times: np.ndarray
    values: np.ndarray

    @property
    def spread(self) -> float:
        """One standard deviation of its values."""
        return float(self.values.std())

    def at(self, when: datetime) -> float:
        """Its value then. BadInput for a time that the file says nothing of."""
        second = when.timestamp()
        if not self.times[0] - _AROUND_S <= second <= self.times[-1] + _AROUND_S:
            first, last = (datetime.fromtimestamp(t, UTC).date() for t in (self.times[0], self.times[-1]))
            raise BadInput(
                f"{self.path} says nothing of {when.date()}",
                where="--covariate",
                allowed=f"{first} to {last}",
                todo="Give a file that covers all versions and recordings that are compared",
            )
        return float(np.interp(second, self.times, self.values))


def read_covariate(path: Path) -> Covariate:
    """A CSV file with a heading and two columns, a time (ISO 8601, UTC without a zone; or seconds since 1970) and a
    number. Raises BadInput."""
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
    return Covariate(path, times, values)


def _seconds(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        found = datetime.fromisoformat(text.strip())
        return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()
