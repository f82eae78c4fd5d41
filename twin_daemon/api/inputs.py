"""What the functions take: a hand and its recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path

import numpy as np

from twin_daemon.errors import BadInput, UsageError
from twin_daemon.hand import Hand, load_hand
from twin_daemon.recordings import Recording as Recorded
from twin_daemon.recordings import load_joint_map, load_recording
from twin_daemon.workflows.session import Session, open_session

Text = str | PathLike[str]


@dataclass(frozen=True)
class Robot:
    """A hand or any other robot."""

    description: Hand
    """Joints, commands and limits, and how they fit the model."""
    name: str | None = None
    """What `--hand` would be given."""
    model: Path | None = None
    """What `--model` would be given."""

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints by their names in the data."""
        return tuple(self.description.joints)

    @property
    def commands(self) -> tuple[str, ...]:
        """The commands that drive them."""
        return tuple(self.description.commands)


@dataclass(frozen=True)
class Recording:
    """A recording of a robot: a bag, an MCAP, a CSV or a folder of these. Read when something of it is asked for."""

    path: Path
    """Where it is."""
    robot: Robot
    """Whose it is."""
    trajectory: str | None = None
    """What was commanded, where it holds no commands: `FILE.yaml:NAME`."""
    joint_map: Path | None = None
    """A file that renames its joints."""

    @cached_property
    def data(self) -> Recorded:
        """What is in it. Raises BadInput where nothing can be read."""
        return load_recording(self.path, load_joint_map(self.joint_map) if self.joint_map else None)

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that it measures."""
        return self.data.joints

    @property
    def time_s(self) -> np.ndarray:
        """(n,) s since the first measurement."""
        return (self.data.stamp_ns - self.data.stamp_ns[0]) * 1e-9

    @property
    def position_rad(self) -> np.ndarray:
        """(n, j) rad as measured, in the order of `joints`; NaN where nothing was."""
        return self.data.position


Recordings = Recording | Sequence[Recording]


def hand(name: Text | None = None, *, model: Text | None = None) -> Robot:
    """A hand by its `name` ("shadow_hand") or the path of its description, or any robot by its MJCF as `model`.

    Without arguments it is the Shadow Hand. Raises BadInput for an unknown hand or a model that cannot be used.
    """
    chosen, path = None if name is None else str(name), None if model is None else Path(model)
    return Robot(load_hand(chosen, path), chosen, path)


def recording(
    path: Text, hand: Robot | None = None, *, trajectory: str | None = None, joint_map: Text | None = None
) -> Recording:
    """A recording of a robot, of the Shadow Hand where none is given; it is read when it is needed.

    `path`: a ROS 1 or ROS 2 bag, an MCAP, a CSV or a folder of these. `trajectory`: "FILE.yaml:NAME", what was
    commanded where the recording has no commands. `joint_map`: a YAML file that renames joints of the data. Raises
    BadInput where there is no such file.
    """
    found = Path(path)
    if not found.exists():
        raise BadInput("there is no such recording", where=found, todo="Give the path of a bag, an MCAP or a CSV")
    return Recording(found, hand or _default_hand(), trajectory, None if joint_map is None else Path(joint_map))


def _default_hand() -> Robot:
    return hand()


def as_list(recordings: Recordings | None) -> list[Recording]:
    """One or several, as several."""
    if recordings is None:
        return []
    return [recordings] if isinstance(recordings, Recording) else list(recordings)


def opened(robot: Robot, version: str | None, terms: Text | None, recordings: Sequence[Recording]) -> Session:
    """The twin in question, and how recordings of it are read."""
    if any(one.robot.description != robot.description for one in recordings):
        raise UsageError("the recordings are of different robots", todo="Give those of one robot at once")
    maps = {one.joint_map for one in recordings}
    if len(maps) > 1 or len({one.trajectory for one in recordings}) > 1:
        raise UsageError("the recordings have different joint maps or trajectories", todo="Give them alike")
    return open_session(
        robot.name,
        robot.model,
        version=version,
        terms=None if terms is None else Path(terms),
        joint_map=maps.pop() if maps else None,
    )


def of(recordings: Recordings) -> tuple[list[Recording], Robot]:
    """(recordings, whose they are). Raises UsageError for none."""
    found = as_list(recordings)
    if not found:
        raise UsageError("no recording", todo="Give one: td.recording(path, hand)")
    return found, found[0].robot


def paths(recordings: Sequence[Recording]) -> list[Path]:
    return [one.path for one in recordings]


def trajectory_of(recordings: Sequence[Recording]) -> str | None:
    return recordings[0].trajectory if recordings else None
