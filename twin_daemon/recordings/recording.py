"""What was measured and what was commanded, on one clock, as plain arrays that nobody can change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np

from twin_daemon.errors import BadInput, nearest
from twin_daemon.recordings.quality import Quality, measure_timing


@dataclass(frozen=True)
class Commands:
    """Position targets by command name, J0 of a coupled pair included.

    `stamp_ns` (m,) int64, strictly increasing. `position` (m, k) rad; NaN where a message did not carry that name.
    A streamed target holds until the next one ("hold"); between the points of a trajectory it is "linear".
    """

    stamp_ns: np.ndarray
    names: tuple[str, ...]
    position: np.ndarray
    interpolation: Literal["hold", "linear"]

    def __post_init__(self) -> None:
        _freeze(self.stamp_ns, self.position)


@dataclass(frozen=True)
class Recording:
    """One recorded motion.

    `stamp_ns` (n,) int64, strictly increasing: header stamps. `position` (n, j) rad, `velocity` (n, j) rad/s or None,
    `effort` (n, j) in the unit of the source or None; NaN where a message did not carry that joint.
    `sha256` is that of the file's bytes, or of the sorted files of a folder.
    """

    name: str
    path: Path
    sha256: str
    joints: tuple[str, ...]
    stamp_ns: np.ndarray
    position: np.ndarray
    velocity: np.ndarray | None
    effort: np.ndarray | None
    commands: Commands | None
    quality: Quality

    def __post_init__(self) -> None:
        _freeze(self.stamp_ns, self.position, self.velocity, self.effort)

    @property
    def time_s(self) -> np.ndarray:
        """(n,) seconds since the first sample."""
        return (self.stamp_ns - self.stamp_ns[0]) * 1e-9

    @property
    def began(self) -> datetime:
        """When it begins, UTC."""
        return datetime.fromtimestamp(int(self.stamp_ns[0]) * 1e-9, UTC)

    @property
    def duration_s(self) -> float:
        """Seconds from the first to the last sample."""
        return float((self.stamp_ns[-1] - self.stamp_ns[0]) * 1e-9)

    def select(self, joints: Sequence[str]) -> Recording:
        """Only these joints, in this order. Samples that carry none of them are left out; commands stay."""
        if not joints:
            raise BadInput("no joints selected", where=self.name, allowed=", ".join(self.joints))
        unknown = [name for name in joints if name not in self.joints]
        if unknown:
            raise BadInput(f"no joint '{unknown[0]}'", where=self.name, todo=nearest(unknown[0], self.joints))
        columns = [self.joints.index(name) for name in joints]
        rows = np.asarray(np.isfinite(self.position[:, columns]).any(axis=1))
        if not rows.any():
            raise BadInput(f"no sample carries {', '.join(joints)}", where=self.name)
        return self._part(rows, columns)

    def window(self, start_s: float, end_s: float | None = None) -> Recording:
        """The samples with start_s <= time < end_s (no end: to the last), so that adjoining windows share none.

        All commands stay: the target that is in force at the start was sent before it.
        """
        time_s = self.time_s
        rows = np.asarray(time_s >= start_s)
        if end_s is not None:
            rows &= time_s < end_s
        if not rows.any():
            raise BadInput(
                f"no samples from {start_s:g} s to {self.duration_s if end_s is None else end_s:g} s",
                where=self.name,
                allowed=f"0 to {self.duration_s:g} s",
            )
        return self._part(rows, list(range(len(self.joints))))

    def linked(self, path: Path) -> Recording:
        """The same recording as it is called at another path of the same file."""
        return replace(self, name=name_of_file(path), path=path)

    def renamed(self, names: Mapping[str, str]) -> Recording:
        """The same recording with joints and commands renamed; names that are not in `names` stay."""
        commands = self.commands
        if commands is not None:
            commands = replace(commands, names=tuple(names.get(name, name) for name in commands.names))
        return replace(self, joints=tuple(names.get(name, name) for name in self.joints), commands=commands)

    def _part(self, rows: np.ndarray, columns: list[int]) -> Recording:
        def cut(values: np.ndarray | None) -> np.ndarray | None:
            return None if values is None else values[rows][:, columns]

        stamp_ns = self.stamp_ns[rows]
        return replace(
            self,
            joints=tuple(self.joints[column] for column in columns),
            stamp_ns=stamp_ns,
            position=self.position[rows][:, columns],
            velocity=cut(self.velocity),
            effort=cut(self.effort),
            quality=replace(self.quality, **measure_timing(stamp_ns)),
        )


def name_of_file(path: Path) -> str:
    """What a recording of a single file is called."""
    return path.name.removesuffix(".gz").rsplit(".", 1)[0]


def _freeze(*arrays: np.ndarray | None) -> None:
    for array in arrays:
        if array is not None:
            array.flags.writeable = False
