"""The stand-in hand on the network: a plant in real time that talks as the real hand's driver does."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass

import numpy as np
import zenoh

from bridges.zenoh.connection import Connection
from bridges.zenoh.sources import Speaker
from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample, MalformedPayload
from twin_daemon.hand import Hand, HandDescription, match
from twin_daemon.plant import Hardware
from twin_daemon.services.pace import Pace
from twin_daemon.services.stop import Stoppable
from twin_daemon.signals.trajectory import Trajectory

_PAUSE_S = 0.5
Entities = tuple[Speaker, Speaker, object]


@dataclass
class Counts:
    """What a stand-in has done."""

    joint_states: int = 0
    own_commands: int = 0
    followed_commands: int = 0
    refused_commands: int = 0
    stalls: int = 0


class StandIn:
    """Publishes joint states at a rate, moves by its own motion, and obeys commands of others once they come.

    The own motion (by command name, rad) repeats after a short pause; it ends for good with the first command of
    somebody else, since two masters would tear at one hand. Where the description names a key for the driver's stop,
    anything that is put there holds the hand where it is, until this process ends.
    """

    def __init__(
        self, plant: Hardware, description: HandDescription, rate_hz: float, motion: Trajectory | None
    ) -> None:
        self._plant = plant
        self._description = description
        self._period_s = 1.0 / rate_hz
        self._motion = motion
        self._inbox: list[JointSample] = []
        self._lock = threading.Lock()
        self.counts = Counts()
        self.obeys_others = False
        self.stopped = self._held = False

    def run(self, connection: Connection, stop: Stoppable, seconds: float | None = None) -> None:
        """Real time until `stop` is set or `seconds` have passed. Nobody needs to listen."""
        pace, tick = Pace(stop), 0
        entities: Entities | None = None
        begin_ns = time.time_ns()
        while pace.wait_until(tick * self._period_s):
            if seconds is not None and tick * self._period_s >= seconds:
                break
            if entities is None and connection.session is not None:
                entities = self._declare(connection.session)
            stamp_ns = begin_ns + round((tick * self._period_s + pace.lost_s) * 1e9)
            self._turn(stamp_ns, tick * self._period_s, entities)
            tick += 1
        self.counts.stalls = pace.stalls

    def _declare(self, session: zenoh.Session) -> Entities:
        states = Speaker(session.declare_publisher(self._description.key("joint_states")))
        commands = Speaker(session.declare_publisher(self._description.key("joint_commands")))
        others = session.declare_subscriber(
            self._description.key("joint_commands"), self._receive, allowed_origin=zenoh.Locality.REMOTE
        )
        own_stop = self._description.stop
        if own_stop is not None and own_stop.zenoh_key is not None:
            others = others, session.declare_subscriber(own_stop.zenoh_key, self._hold)
        return states, commands, others

    def _hold(self, _: zenoh.Sample) -> None:
        self.stopped = True

    def _receive(self, sample: zenoh.Sample) -> None:
        try:
            command = cdr.decode(sample.payload.to_bytes())
        except MalformedPayload:
            self.counts.refused_commands += 1
            return
        if len(command.position) != len(command.names):
            self.counts.refused_commands += 1
            return
        with self._lock:
            self._inbox = [*self._inbox[-50:], command]

    # -- one turn ------------------------------------------------------------------------------------------

    def _turn(self, stamp_ns: int, time_s: float, entities: Entities | None) -> None:
        """Targets first, then the reading, both at this stamp; then the plant moves on to the next."""
        names, position, velocity, effort = self._plant.measure()
        if self.stopped:
            command = None
            if not self._held:
                self._held = True
                self._plant.set_targets(by_command(self._description, JointSample(stamp_ns, names, position)))
        else:
            self._obey_others()
            command = self._own_command(stamp_ns, time_s)
        if entities is not None:
            states, commands, _ = entities
            if command is not None:
                commands.put(cdr.encode(command))
                self.counts.own_commands += 1
            states.put(cdr.encode(JointSample(stamp_ns, names, position, velocity, effort)))
            self.counts.joint_states += 1
        self._plant.advance(self._period_s)

    def _obey_others(self) -> None:
        with self._lock:
            waiting, self._inbox = self._inbox, []
        for command in waiting:
            targets = by_command(self._description, command)
            if not targets:
                self.counts.refused_commands += 1
                continue
            self.obeys_others = True
            self.counts.followed_commands += 1
            self._plant.set_targets(targets)

    def _own_command(self, stamp_ns: int, time_s: float) -> JointSample | None:
        if self._motion is None or self.obeys_others:
            return None
        phase_s = time_s % (self._motion.duration_s + _PAUSE_S)
        position = self._motion.sample(np.array([phase_s]))[0]
        self._plant.set_targets(dict(zip(self._motion.joints, position.tolist(), strict=True)))
        return JointSample(stamp_ns, self._motion.joints, position)


def by_command(description: HandDescription, sample: JointSample) -> dict[str, float]:
    """Finite targets of a message by the hand's own command names; J1 and J2 together are their J0."""
    given = {
        name: float(value) for name, value in zip(sample.names, sample.position, strict=True) if np.isfinite(value)
    }
    targets = {}
    for command, info in description.commands.items():
        direct = match(command, given)
        parts = [match(joint, given) for joint in info.joints]
        if direct is not None:
            targets[command] = given[direct]
        elif all(part is not None for part in parts):
            targets[command] = sum(given[part] for part in parts if part is not None)
    return targets


def easy_motion(hand: Hand, period_s: float = 6.0) -> Trajectory:
    """A closed motion for any hand: each command goes smoothly from its rest part of the way to a limit and back.

    Commands differ in how often they do it, so that every joint is seen moving alone as well as with others.
    """
    times_s = np.linspace(0.0, period_s, 121)
    names = [name for name in hand.commands if np.isfinite(hand.command_range_rad[name]).all()]
    columns = []
    for index, name in enumerate(names):
        rest, high = _rest_rad(hand, name), hand.command_range_rad[name][1]
        wave = 0.5 * (1.0 - np.cos(2.0 * np.pi * (1 + index % 2) * times_s / period_s))
        columns.append(rest + 0.5 * (high - rest) * wave)
    return Trajectory("easy", tuple(names), times_s, np.stack(columns, axis=1))


def holding_the_rest(motion: Trajectory, hand: Hand) -> Trajectory:
    """The same motion (by command) with every other command held at rest, as a controller of the whole hand does.

    Otherwise those who listen would go on believing targets from before this hand was switched on.
    """
    others = [name for name in hand.commands if name not in motion.joints]
    held = np.array([_rest_rad(hand, name) for name in others])
    positions = np.column_stack([motion.positions, np.tile(held, (len(motion.times_s), 1))])
    return Trajectory(motion.name, (*motion.joints, *others), motion.times_s, positions, motion.notes)


def _rest_rad(hand: Hand, command: str) -> float:
    low, high = hand.command_range_rad[command]
    return min(max(0.0, low), high)
