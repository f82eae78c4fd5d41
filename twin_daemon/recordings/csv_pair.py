"""Folders of two CSV files: control (what was commanded) and state_motor (what was measured)."""

from __future__ import annotations

import csv
from collections import Counter
from decimal import Decimal, InvalidOperation
from pathlib import Path

from twin_daemon.errors import BadInput
from twin_daemon.recordings.assemble import Stream, assemble
from twin_daemon.recordings.bag import Contents
from twin_daemon.recordings.csv_cells import lines, numbers, open_text
from twin_daemon.recordings.recording import Commands
from twin_daemon.recordings.rows import Rows

JOINT_LIST = "joint_list.txt"
_MAX_NS = 2**63 - 1
_MAX_JOINTS = 1024


def pair_file(folder: Path, stem: str) -> Path | None:
    """The folder's control or state_motor file, packed or not."""
    return next((path for suffix in (".csv", ".csv.gz") if (path := folder / f"{stem}{suffix}").is_file()), None)


def pair_files(folder: Path) -> list[Path]:
    """The files that make up a recording of this form."""
    return [path for stem in ("control", "state_motor") if (path := pair_file(folder, stem)) is not None]


def read_csv_pair(folder: Path) -> Contents:
    """A folder with state_motor.csv[.gz], control.csv[.gz] and joint_list.txt in it or in the folder above."""
    joints = _joint_list(folder)
    state = pair_file(folder, "state_motor")
    if state is None:
        raise BadInput("no state_motor.csv or state_motor.csv.gz", allowed="control and state_motor in one folder")
    dropped: Counter[str] = Counter()
    measured, messages = _stream(state, joints, ("velocities", "torques"), dropped)
    if measured is None:
        raise BadInput(f"none of the {messages} lines of {state.name} is usable for {len(joints)} joints")
    contents = Contents(measured, messages, dropped=dropped)
    control = pair_file(folder, "control")
    if control is None:
        contents.notes.append("no control.csv: the commands are unknown")
        return contents
    commanded, _ = _stream(control, joints, (), contents.commands_dropped)
    if commanded is None:
        contents.notes.append(f"{control.name}: no line is usable, so the commands are unknown")
    else:
        contents.commands = Commands(commanded.stamp_ns, commanded.joints, commanded.position, "hold")
    return contents


def _joint_list(folder: Path) -> tuple[str, ...]:
    path = next((p for p in (folder / JOINT_LIST, folder.resolve().parent / JOINT_LIST) if p.is_file()), None)
    if path is None:
        raise BadInput(
            f"no {JOINT_LIST}", allowed="in the folder or in the one above it", todo="Write one joint a line"
        )
    with path.open(encoding="utf-8-sig") as text:
        joints = tuple(name for line in lines(text, path) if (name := line.strip()))
    if not joints or len(joints) > _MAX_JOINTS or len(set(joints)) != len(joints):
        raise BadInput(f"{path.name} has no joints, too many or one of them twice", allowed="one joint a line")
    return joints


def _stream(
    path: Path, joints: tuple[str, ...], optional: tuple[str, ...], dropped: Counter[str]
) -> tuple[Stream | None, int]:
    """Columns timestamp (us) and positions (rad), and velocity and effort where `optional` names their columns."""
    parts: dict[tuple[bool, bool], Rows] = {}
    messages = 0
    with open_text(path) as text:
        records = csv.reader(lines(text, path))
        columns = [column.strip() for column in next(records, [])]
        missing = [column for column in ("timestamp", "positions") if column not in columns]
        if missing:
            raise BadInput(f"{path.name} has no column {', '.join(missing)}", allowed="timestamp (us), positions (rad)")
        stamp_at, position_at = columns.index("timestamp"), columns.index("positions")
        extra_at = [columns.index(column) if column in columns else -1 for column in optional]
        for record in records:
            if not record:
                continue
            messages += 1
            try:
                stamp_ns = _nanoseconds(record[stamp_at])
                position = numbers(record[position_at])
                extra = [numbers(record[at]) if at >= 0 else [] for at in extra_at]
            except (ValueError, IndexError, InvalidOperation):
                dropped["undecodable"] += 1
                continue
            if len(position) != len(joints):
                dropped["wrong_length"] += 1
                continue
            velocity, effort = extra or ([], [])
            for kind, values in (("velocity", velocity), ("effort", effort)):
                if values and len(values) != len(joints):
                    dropped[f"{kind}_wrong_length"] += 1
            key = (len(velocity) == len(joints), len(effort) == len(joints))
            rows = parts.setdefault(key, Rows(joints, velocity=key[0], effort=key[1]))
            rows.add(stamp_ns, stamp_ns, messages, position, velocity, effort)
    return assemble(list(parts.values()), dropped, zero_is_unset=False), messages


def _nanoseconds(cell: str) -> int:
    """Microseconds, maybe with a fraction, to the nearest nanosecond; a float would lose some since 1970."""
    stamp_ns = round(Decimal(cell.strip()) * 1000)
    if not 0 <= stamp_ns <= _MAX_NS:
        raise ValueError("a stamp out of range")
    return stamp_ns
