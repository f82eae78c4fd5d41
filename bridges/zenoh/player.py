"""A recording on the network as if it were the hand."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass

import numpy as np

from bridges.zenoh.connection import Connection
from bridges.zenoh.sources import Speaker
from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample
from twin_daemon.hand import HandDescription
from twin_daemon.recordings import Recording
from twin_daemon.recordings.recording import Commands
from twin_daemon.services.pace import Pace
from twin_daemon.services.stop import Stoppable

_LISTENER_WAIT_S = 30.0
"""A daemon that begins has its gate on the network before itself; on a busy machine its model takes long to load."""
_SAY_WAITING_S = 1.0
_GAP_BETWEEN_NS = 1_000_000_000
AHEAD_S = 0.1
"""How long before its moment a command is sent, in wall time."""
MOST_AHEAD_S = 0.3
"""The same by its stamp: farther ahead the twin would take it for one of another clock."""


log = logging.getLogger("twin.play")


@dataclass
class Played:
    """What was put on the network."""

    joint_states: int = 0
    joint_commands: int = 0
    duration_s: float = 0.0
    stalls: int = 0
    listened: bool = False


@dataclass(frozen=True)
class Timeline:
    """States and commands of one recording in the order in which they are `due`; a command before its moment.

    Two streams may overtake each other on the way, and a command holds from its stamp on, whenever it arrives.
    """

    recording: Recording
    commands: Commands | None
    stamp_ns: np.ndarray  # (m,) int64
    due_ns: np.ndarray  # (m,) int64
    is_command: np.ndarray  # (m,) bool
    row: np.ndarray  # (m,) int

    @classmethod
    def of(cls, recording: Recording, commands: Commands | None, ahead_ns: int = 0) -> Timeline:
        states = recording.stamp_ns
        told = commands.stamp_ns if commands is not None else np.zeros(0, dtype=np.int64)
        stamps = np.concatenate([told, states])
        kind = np.concatenate([np.ones(len(told), bool), np.zeros(len(states), bool)])
        rows = np.concatenate([np.arange(len(told)), np.arange(len(states))])
        due = stamps - np.where(kind, ahead_ns, 0)
        order = np.argsort(due, kind="stable")
        return cls(recording, commands, stamps[order], due[order], kind[order], rows[order])

    def sample(self, index: int, shift_ns: int) -> JointSample:
        """One message, its stamp shifted; joints that the original message lacked are left out."""
        row, stamp_ns = int(self.row[index]), int(self.stamp_ns[index]) + shift_ns
        if self.is_command[index] and self.commands is not None:
            names, position, more = self.commands.names, self.commands.position[row], {}
        else:
            recording = self.recording
            names, position = recording.joints, recording.position[row]
            extra = {"velocity": recording.velocity, "effort": recording.effort}
            more = {key: values[row] for key, values in extra.items() if values is not None}
        there = np.isfinite(position)
        if there.all():
            return JointSample(stamp_ns, names, position, **more)
        kept = tuple(name for name, known in zip(names, there, strict=True) if known)
        return JointSample(stamp_ns, kept, position[there], **{key: values[there] for key, values in more.items()})


def play(
    timelines: list[Timeline],
    description: HandDescription,
    connection: Connection,
    stop: Stoppable,
    *,
    speed: float = 1.0,
    loop: bool = False,
    keep_stamps: bool = False,
) -> Played:
    """Publishes recordings one after the other in (scaled) real time; the time between stamps stays what it was.

    Stamps are moved to the present, so that a message is as old as it looks, unless `keep_stamps`.
    """
    played = Played()
    while connection.session is None:
        if stop.wait(0.02):
            return played
    states = Speaker(connection.session.declare_publisher(description.key("joint_states")))
    commands = Speaker(connection.session.declare_publisher(description.key("joint_commands")))
    # who hears one stream and not yet the other would get commands after the states that they lead to
    needed = [states, *([commands] if any(t.is_command.any() for t in timelines) else [])]
    if not _heard(needed, _SAY_WAITING_S, stop):
        log.info(
            "waiting for somebody who listens to %s, %g s at most", description.key("joint_states"), _LISTENER_WAIT_S
        )
        _heard(needed, _LISTENER_WAIT_S - _SAY_WAITING_S, stop)
    played.listened = states.is_heard
    pace, begun_s = Pace(stop), time.monotonic()
    next_ns, elapsed_s, round_number = time.time_ns(), 0.0, 0
    while not stop.is_set() and (loop or round_number == 0):
        for timeline in timelines:
            first_ns = int(timeline.stamp_ns.min())
            shift_ns = 0 if keep_stamps else next_ns - first_ns
            for index, due_ns in enumerate(timeline.due_ns):
                if not pace.wait_until(elapsed_s + (int(due_ns) - first_ns) * 1e-9 / speed):
                    break
                payload = cdr.encode(timeline.sample(index, shift_ns))
                if timeline.is_command[index]:
                    commands.put(payload)
                    played.joint_commands += 1
                else:
                    states.put(payload)
                    played.joint_states += 1
            length_ns = int(timeline.stamp_ns.max()) - first_ns + _GAP_BETWEEN_NS
            next_ns += length_ns
            elapsed_s += length_ns * 1e-9 / speed
        round_number += 1
    played.duration_s = time.monotonic() - begun_s
    played.stalls = pace.stalls
    return played


def _heard(speakers: list[Speaker], timeout_s: float, stop: Stoppable) -> bool:
    deadline_s = time.monotonic() + timeout_s
    while not all(one.is_heard for one in speakers):
        if time.monotonic() >= deadline_s or stop.wait(0.02):
            return False
    return True
