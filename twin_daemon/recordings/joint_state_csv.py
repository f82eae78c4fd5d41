"""CSV files of joint states, a message a line: columns name, position, velocity, effort and timestamp_nsecs."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from twin_daemon.errors import BadInput
from twin_daemon.recordings.assemble import assemble
from twin_daemon.recordings.bag import Contents
from twin_daemon.recordings.csv_cells import lines, names, numbers, open_text
from twin_daemon.recordings.rows import Rows

REQUIRED = ("name", "position", "timestamp_nsecs")
COLUMNS = (*REQUIRED, "velocity", "effort")
_MAX_NS = 2**63 - 1
_MAX_NAMES_CELLS = 256


def read_joint_state_csv(path: Path) -> Contents:
    """A CSV of joint states; velocity and effort may be missing, other columns are not looked at."""
    dropped: Counter[str] = Counter()
    collector = _Collector(dropped)
    with open_text(path) as text:
        source = lines(text, path)
        header = next(csv.reader([next(source, "")]), [])
        columns = [column.strip() for column in header]
        missing = [column for column in REQUIRED if column not in columns]
        if missing:
            raise BadInput(
                f"no column {', '.join(missing)} ({_others(columns)})",
                allowed="name, position, velocity, effort, timestamp_nsecs",
            )
        collector.read(_records(source), columns)
    measured = assemble(list(collector.parts.values()), dropped, zero_is_unset=False)
    if measured is None:
        raise BadInput(f"none of its {collector.messages} lines is a usable joint state")
    return Contents(measured, collector.messages, dropped=dropped)


def _others(columns: list[str]) -> str:
    """What there is instead, in words: what is no recording is not quoted, for it may be anything."""
    known = [column for column in columns if column in COLUMNS]
    return f"of its {len(columns)} columns {', '.join(known) if known else 'none'} is known"


class _Collector:
    def __init__(self, dropped: Counter[str]) -> None:
        self.parts: dict[tuple[tuple[str, ...], bool, bool], Rows] = {}
        self.messages = 0
        self._dropped = dropped
        self._names: dict[str, tuple[str, ...]] = {}  # by cell: every line repeats it

    def read(self, records: Iterator[Sequence[str]], columns: list[str]) -> None:
        name_at, position_at, stamp_at = (columns.index(column) for column in REQUIRED)
        velocity_at, effort_at = (columns.index(c) if c in columns else -1 for c in ("velocity", "effort"))
        for record in records:
            if not record:
                continue
            order = self.messages
            self.messages += 1
            try:
                joints = self._joints(record[name_at])
                position = numbers(record[position_at])
                velocity = numbers(record[velocity_at]) if velocity_at >= 0 else []
                effort = numbers(record[effort_at]) if effort_at >= 0 else []
                stamp_ns = int(record[stamp_at])
            except (ValueError, IndexError):
                self._dropped["undecodable"] += 1
                continue
            if not 0 <= stamp_ns <= _MAX_NS:
                self._dropped["undecodable"] += 1
            elif len(position) != len(joints):
                self._dropped["wrong_length"] += 1
            elif not joints:
                self._dropped["empty"] += 1
            elif len(set(joints)) != len(joints):
                self._dropped["repeated_names"] += 1
            else:
                for key, values in (("velocity", velocity), ("effort", effort)):
                    if values and len(values) != len(joints):
                        self._dropped[f"{key}_wrong_length"] += 1
                has_velocity, has_effort = len(velocity) == len(joints), len(effort) == len(joints)
                key = (joints, has_velocity, has_effort)
                rows = self.parts.get(key)
                if rows is None:
                    rows = self.parts[key] = Rows(joints, velocity=has_velocity, effort=has_effort)
                rows.add(stamp_ns, stamp_ns, order, position, velocity, effort)

    def _joints(self, cell: str) -> tuple[str, ...]:
        joints = self._names.get(cell)
        if joints is None:
            joints = names(cell)
            if len(self._names) >= _MAX_NAMES_CELLS:
                self._names.clear()
            self._names[cell] = joints
        return joints


def _records(source: Iterator[str]) -> Iterator[Sequence[str]]:
    """The cells of each line that is not blank.

    Splitting at the quotes gives the same as the csv module several times faster, wherever no cell contains a quote or
    a line break; lines of any other form are left to the module.
    """
    for line in source:
        plain = line.rstrip("\r\n")
        if not plain:
            continue
        record = split_line(plain)
        if record is None:
            yield from csv.reader(_until_closed(line, source))
        else:
            yield record


def split_line(line: str) -> list[str] | None:
    """The cells of a line, or None where splitting might not give what the csv module gives."""
    first, *parts = line.split('"')
    if not parts:
        return first.split(",")
    if len(parts) % 2:
        return None  # a quote is still open at the end of the line
    if first and not first.endswith(","):
        return None
    cells = first[:-1].split(",") if first else []
    for index in range(0, len(parts), 2):
        cells.append(parts[index])
        between = parts[index + 1]  # the commas, and the plain cells among them
        if index + 2 == len(parts):
            if between and not between.startswith(","):
                return None
            cells.extend(between[1:].split(",") if between else ())
        elif between != ",":
            if len(between) < 2 or between[0] != "," or between[-1] != ",":
                return None
            cells.extend(between[1:-1].split(","))
    return cells


def _until_closed(line: str, source: Iterator[str]) -> Iterator[str]:
    yield line
    open_quote = line.count('"') % 2 == 1
    while open_quote and (following := next(source, None)) is not None:
        open_quote ^= following.count('"') % 2 == 1
        yield following
