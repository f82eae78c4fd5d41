"""Random commanders against the gate: whatever is asked, what leaves the gate is within every limit.

    python -m bench.gate_streams --commands 1000000

Each stream is a life of one gate under a made-up clock: several commanders at once, with and without the right to
command, numbers that jump or are none, requests that are old, repeated or out of order, clocks that jump, a hand that
falls silent or says nonsense, somebody who sends past the gate, blocked fingers, sensors that lie, a second source of
states, a gate that is killed and started again. After every turn what was sent is held against the limits, a first
command against what the hand has said, an overlap against the last reading that can be, and the setpoints after a
protective stop against the contact.
"""

from __future__ import annotations

import argparse
import functools
import multiprocessing
import sys
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from bench.gate_faults import Contact, Fault, Starts
from twin_daemon.gate.gate import Gate
from twin_daemon.gate.limits import Limits
from twin_daemon.gate.preview import Preview
from twin_daemon.gate.requests import KINDS, Request
from twin_daemon.gate.sendable import Sendable
from twin_daemon.gate.settings import GateSettings
from twin_daemon.hand import load_hand
from twin_daemon.security.identity import NOBODY, Who
from twin_daemon.simulation.twin import TwinModel

PEOPLE = (Who("ann", "operator"), Who("bob", "operator"), Who("eve", "viewer"), NOBODY, None)
_EPS = 1e-9
_AT_ONCE = 10  # streams of one job


class Watch:
    """Holds every command that leaves a gate against the limits, by differences of what was sent alone."""

    def __init__(self, limits: Limits, dt_s: float, preview: Preview, depth_m: float) -> None:
        self._limits, self._dt_s, self._preview, self._depth_m = limits, dt_s, preview, depth_m
        self._row = np.full(len(limits.names), np.nan)
        self._first = np.full(len(limits.names), np.nan)
        self._velocity = np.zeros(len(limits.names))
        self._slack = 0.0  # rad/s: what rounding made of the last velocity
        self._stamp_ns = 0
        self.sent = 0

    @property
    def row(self) -> np.ndarray:
        """(c,) rad: what is in force; NaN where nothing has been sent."""
        return self._row.copy()

    def restarted(self) -> None:
        """A gate that is a new one begins its stamps anew."""
        self._stamp_ns = 0

    def idle(self) -> None:
        """Nothing is under way: the hand may be moved by others, and the next command starts anew."""
        self._row[:] = np.nan
        self._first[:] = np.nan
        self._velocity[:] = 0.0

    def displaced(self) -> None:
        """Somebody has sent the hand elsewhere, past the gate: what overlaps from now on because of it is his doing."""
        self._first = self._row.copy()

    def turn(
        self,
        sent: Sendable | None,
        since_s: float,
        start: np.ndarray,
        measured: np.ndarray,
        there: np.ndarray,
        *,
        look: bool,
        hand: np.ndarray | None = None,
    ) -> None:
        """One turn of the gate, `since_s` after the one before; `start` (c,) is where new commands begin.

        `measured` (j,) is what was read last that can be, and `there` (c,) where commands without a setpoint are by it.
        `hand` (c,) is where the hand truly is while it lets go: setpoints that come back to it overlap no more than it
        does there, ahead by the margin that holds links up.
        """
        dt_s = min(since_s, self._dt_s)
        row = self._row.copy()
        if sent is not None:
            assert type(sent) is Sendable
            assert sent.stamp_ns > self._stamp_ns
            assert np.isfinite(sent.position).all()
            self._stamp_ns = sent.stamp_ns
            for name, value in zip(sent.names, sent.position, strict=True):
                row[self._limits.names.index(name)] = value
            self.sent += 1
        before = np.where(np.isfinite(self._row), self._row, start)
        given = np.isfinite(row)
        assert (row[given] >= self._limits.lower[given]).all(), "below its bound"
        assert (row[given] <= self._limits.upper[given]).all(), "above its bound"
        if dt_s > 0.0:
            velocity = np.where(given, (row - before) / dt_s, 0.0)
            slack = _EPS / dt_s
            assert (np.abs(velocity) <= self._limits.velocity + slack).all(), "too fast"
            change = np.abs(velocity - self._velocity)
            # a nanoradian's rounding in a turn of 10 us is 1e-4 rad/s, there and in the turn that follows
            most = self._limits.acceleration * dt_s * (1 + 1e-6) + slack + max(slack, self._slack)
            assert (change <= most).all(), "too sudden"
            self._velocity, self._slack = velocity, slack
        else:
            assert np.array_equal(row[given], before[given]), "moved in no time"
        self._first = np.where(given & ~np.isfinite(self._row), start, self._first)
        moved = not np.array_equal(row[given], before[given])
        self._row = row
        if moved and look:
            then = np.where(given, row, there)
            found = self._preview.along(measured, then[None], now=np.where(given, self._first, there))
            if found is not None and hand is not None:
                margin = self._limits.margin
                held = hand + np.minimum(np.maximum(row - hand, -margin), margin)
                found = self._preview.along(measured, then[None], now=np.where(given, held, there))
            assert found is None, str(found)


class _Latched:
    """A latch that outlives its gate, in memory: the one on disk is tested with real processes."""

    def __init__(self) -> None:
        self.why: str | None = None

    def set(self, why: str, still: Callable[[], bool]) -> None:
        self.why = why if still() else self.why

    def clear(self) -> None:
        self.why = None


class Stream:
    """One life of a gate under random treatment. The same seed gives the same life."""

    def __init__(self, twin: TwinModel, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        settings = GateSettings(rate_hz=float(self.rng.choice([50.0, 125.0, 500.0])), lease_s=5.0, jump_rad=0.5)
        self._twin, self._settings = twin, settings
        self._latch = _Latched()
        self.gate = self._begun()
        self.dt_s = 1.0 / settings.rate_hz
        self.names = self.gate.limits.names
        preview = Preview(twin, settings.collision_depth_m)
        self.watch = Watch(self.gate.limits, self.dt_s, preview, settings.collision_depth_m)
        self.joints = twin.joints
        self.hand = twin.hand
        self.now_s, self.wall_ns, self.sequence, self.lease = 1000.0, 10**18, 0, ""
        self.pose = np.zeros(len(twin.joints))
        self.heard_s = np.full(len(twin.joints), -np.inf)
        self.mute_until_s = 0.0
        self.answers: Counter[str] = Counter()
        self.fault = Fault(twin, self.rng)
        # half of them without other trouble, or hardly a finger would ever press for long
        self.steady = self.rng.random() < 0.5
        self.contact = Contact(self.gate.limits)
        parts = [[twin.joints.index(j) for j in info.joints] for info in twin.hand.description.commands.values()]
        self.starts = Starts(self.gate.limits, settings.start_tolerance_rad, parts)
        self.held = np.full(len(self.names), np.nan)  # what the hand was sent last
        self.said = self.pose.copy()
        self.cannot_be = np.zeros(len(self.pose))
        ranges = np.array([twin.hand.joint_range_rad[joint] for joint in twin.joints])
        beyond = np.array([twin.hand.description.joints[joint].range_tolerance_rad for joint in twin.joints])
        self.least, self.most = ranges[:, 0] - beyond, ranges[:, 1] + beyond

    def _begun(self) -> Gate:
        gate = Gate(self._twin, self._settings, self._audit_sink, session="s", latch=self._latch)  # type: ignore[arg-type]
        gate.clock = lambda: self.now_s
        return gate

    def _audit_sink(self, entry: dict[str, Any]) -> None:
        self.contact.audit_sink(entry, self.now_s)

    def _restart(self) -> None:
        """Killed, and started again: stopped where it was, else read-only, and with nobody's lease."""
        stopped = self.gate.status(self.now_s)["mode"] == "stopped"
        self.gate = self._begun()
        status = self.gate.status(self.now_s)
        assert status["mode"] == ("stopped" if stopped else "read_only"), "a restart lost the latch, or armed"
        assert status["commander"] is None
        assert self.gate.turn(self.now_s, self.wall_ns) is None, "sent after a restart"
        self.watch.idle()
        self.watch.restarted()
        self.starts.restarted()
        self.contact = Contact(self.gate.limits)
        self.held[:] = np.nan  # of what was sent before it this gate knows nothing
        self.heard_s[:] = -np.inf
        self.answers["restarts"] += 1

    def run(self, commands: int) -> Counter[str]:
        """So many requests, with turns of the clock between them."""
        self._hear()
        for _ in range(commands):
            self._ask()
            if self.rng.random() < 0.001:
                self._restart()
            for _ in range(int(self.rng.integers(0, 4))):
                self._turn()
        if self.fault.kind == "blocked":
            self._press()
        for _ in range(200):  # whatever was under way comes to rest
            self.mute_until_s = np.inf
            self._turn()
        assert not self.gate.status(self.now_s)["moving"], "still moving with the hand silent"
        self.answers["sent"] = self.watch.sent
        self.answers["first commands"] = self.starts.looked_at
        self.answers["contacts let go"] = self.contact.stops
        if self.fault.begun:
            self.answers[f"fault: {self.fault.kind}"] = 1
        return self.answers

    def _press(self) -> None:
        """Sends a finger on and on against what blocks it; the gate ends that, and the finger is let go."""
        self.steady, self.mute_until_s = True, 0.0
        for _ in range(round(2.1 / self.dt_s)):  # doubts of before are over, and the sensor is heard
            self._turn()
        for verb in ("release", "disarm", "arm"):
            self._say(verb, **({} if verb == "disarm" else {"reason": "press"}))
        for number in range(round(4.0 / self.dt_s)):
            if number % 2 == 0 and self.gate.status(self.now_s)["mode"] == "armed":
                self._say("target", targets=self._beyond())
            self._turn()

    def _say(self, verb: str, **body: Any) -> None:
        self.sequence += 1
        common = {"session": "s", "sequence": self.sequence, "stamp_ns": self.wall_ns, "lease": self.lease}
        answer = self.gate.ask(verb, _made(verb, common, **body), PEOPLE[0], self.now_s, self.wall_ns)
        self.lease = answer.get("lease", self.lease)

    def _beyond(self) -> dict[str, float]:
        pressed = self.fault.command
        column = self.names.index(pressed)
        return {pressed: min(float(self.gate.start()[column]) + 0.2, float(self.gate.limits.upper[column]))}

    def _turn(self) -> None:
        rng = self.rng
        kind = 0.0 if self.steady else rng.random()
        since_s = self.dt_s if kind < 0.9 else float(rng.choice([0.0, 1e-5, 0.3 * self.dt_s, 2 * self.dt_s, 0.05, 0.4]))
        self.now_s += since_s
        self.wall_ns += int(since_s * 1e9)
        if rng.random() < 0.002:
            self.wall_ns += int(rng.choice([-1, 1]) * rng.choice([10**8, 10**10, 86_400 * 10**9]))
        if rng.random() < 0.003:
            self.mute_until_s = self.now_s + float(rng.choice([0.05, 0.3, 1.0]))
        self._hear()
        if rng.random() < 0.0005:
            stray = rng.normal(size=len(self.names))
            self.gate.seen(int(self.wall_ns), self.names, stray, self.now_s)
            self.watch.displaced()
            self.held[:] = np.nan  # from here on the hand is another's
        heard = self.now_s - float(self.heard_s.min()) < self.dt_s
        self.contact.look(self.fault, self.held, self.now_s, heard)
        idle = not self.gate.active
        if idle:
            self.watch.idle()
            self.contact.sent(self.watch.row)
        start, before = self.gate.start(), self.watch.row
        if self.gate._last_turn_s is None:  # it lets go of what it held before: a first turn is as long as any
            since_s = self.dt_s
        sent = self.gate.turn(self.now_s, self.wall_ns)
        if idle:
            assert sent is None, "sent without being armed"
            return
        hand = self.starts.by_command(self.pose) if self.gate.letting_go else None
        cannot_be = self.starts.by_command(self.cannot_be) > 0.0
        there = np.where(cannot_be, self.starts.by_command(self.said), start)
        self.watch.turn(sent, since_s, start, self.said, there, look=rng.random() < 0.1, hand=hand)
        row = self.watch.row
        self.contact.sent(row)
        fresh = np.isfinite(row) & ~np.isfinite(before)
        if self.gate.status(self.now_s)["motion"] is not None:  # else it lets go of where it has held the hand before
            self.starts.look(fresh, row, self.gate.limits.velocity * self.dt_s, self.now_s)
        self.held = np.where(np.isfinite(row), row, self.held)
        if sent is not None:
            for name, value in zip(sent.names, sent.position, strict=True):
                driven = self.hand.description.commands[name].joints
                for joint in driven:
                    place = self.joints.index(joint)
                    self.pose[place] += 0.5 * (value / len(driven) - self.pose[place])
            self.fault.held(self.pose)

    def _hear(self) -> None:
        if self.now_s < self.mute_until_s:
            return
        self.fault.maybe_begin(self.pose)
        self.fault.speak_beside(self.gate, self.now_s)
        said = self.fault.said(self.pose)
        self.heard_s[:] = self.now_s
        if self.rng.random() < 0.001:
            said[self.rng.integers(len(said))] = self.rng.choice([np.nan, 1e3])
        self.gate.measured(said, self.heard_s)
        possible = (said >= self.least) & (said <= self.most)  # no NaN is
        self.said = np.where(possible, said, self.said)
        self.cannot_be = np.where(np.isfinite(said), ~possible, self.cannot_be).astype(float)
        self.starts.heard(said, self.now_s)

    def _ask(self) -> None:
        rng = self.rng
        status = self.gate.status(self.now_s)
        likely = {"read_only": "arm", "stopped": "release"}.get(status["mode"])
        verbs = ("target", "target", "target", "move", "trajectory", "beat", "beat", "disarm", "stop", "arm", "release")
        weights = np.array([8, 8, 8, 2, 1, 4, 4, 0.1, 0.1, 0.5, 0.2])
        verb = likely if likely and rng.random() < 0.5 else str(rng.choice(verbs, p=weights / weights.sum()))
        who = PEOPLE[0] if self.steady or rng.random() < 0.8 else PEOPLE[int(rng.integers(len(PEOPLE)))]
        self.sequence += 1
        common: dict[str, Any] = {
            "session": "s" if rng.random() < 0.98 else "old",
            "sequence": self.sequence if rng.random() < 0.97 else int(rng.integers(0, self.sequence)),
            "stamp_ns": self.wall_ns
            if self.steady
            else self.wall_ns + int(rng.choice([0, 0, 0, 0, 0, 0, 0, 0, 0, 10**10]) * rng.choice([-1, 1])),
        }
        if verb not in ("stop", "release") and rng.random() < 0.99:
            common["lease"] = self.lease
        if rng.random() < 0.005:
            common["sequence"] = 2**63 - 1
        answer = self.gate.ask(verb, self._request(verb, common), who, self.now_s, self.wall_ns)
        self.lease = answer.get("lease", self.lease)
        self.answers["accepted" if answer["accepted"] else str(answer["check"])] += 1

    def _request(self, verb: str, common: dict[str, Any]) -> Request:
        rng = self.rng
        if verb in ("arm", "release", "stop"):
            return _made(verb, common, reason="work" if rng.random() < 0.95 else "")
        if verb in ("target", "move"):
            seconds = {"seconds": float(rng.choice([0.01, 0.3, 2.0]))} if verb == "move" and rng.random() < 0.5 else {}
            return _made(verb, common, targets=self._targets(), **seconds)
        if verb == "trajectory":
            names = [str(n) for n in rng.choice(self.names, size=3, replace=False)]
            times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.01, 2.0, 4))])
            rows = rng.uniform(-0.3, 1.4, (5, 3)).tolist()
            if rng.random() < 0.1:
                rows[2][0] = float(rng.choice([np.nan, np.inf, 1e9]))
            return _made(verb, common, joints=names, times_s=times.tolist(), positions=rows)
        return _made(verb, common)

    def _targets(self) -> dict[str, float]:
        rng = self.rng
        names = [str(name) for name in rng.choice(self.names, size=int(rng.integers(1, 6)), replace=False)]
        start = dict(zip(self.names, self.gate.start().tolist(), strict=True))
        if self.fault.wall is not None and rng.random() < 0.7:
            return self._beyond()
        size = float(rng.choice([0.02, 0.2, 0.6]))
        found = {name: start[name] + float(rng.normal(0.0, size)) for name in names}
        kind = rng.random()
        if kind < 0.02:
            found[names[0]] = float(rng.choice([np.nan, np.inf, -np.inf, 1e300, 50.0]))
        elif kind < 0.03:
            found["no_such_joint"] = 0.1
        elif kind < 0.04:
            found = {}
        elif kind < 0.05:
            found = {"rh_FFJ1": 0.2}
        return found


def _made(verb: str, common: dict[str, Any], **body: Any) -> Request:
    return KINDS[verb].model_validate({**common, **body})


def _many(job: tuple[int, int, int]) -> tuple[int, Counter[str], list[str]]:
    """Streams from the first on: how many were lived, what the gate answered, and which of them were unsafe."""
    first, count, commands = job
    twin = _twin()
    total: Counter[str] = Counter()
    unsafe: list[str] = []
    for seed in range(first, first + count):
        stream = Stream(twin, seed)
        try:
            total += stream.run(commands)
        except AssertionError as error:
            total["sent"] += stream.watch.sent
            unsafe.append(f"stream {seed} ({stream.fault.kind} {stream.fault.command}): {error}")
    return count, total, unsafe


@functools.cache
def _twin() -> TwinModel:
    return TwinModel.load(load_hand())


def main() -> None:
    """Runs the streams on several processes and says what the gate answered; exit code 1 if any was unsafe."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--commands", type=int, default=1_000_000, help="in all")
    parser.add_argument("--length", type=int, default=200, help="commands of one stream")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0, help="of the first stream; alone with --commands as --length")
    parser.add_argument("--minutes", type=float, default=np.inf, help="begin no more streams after that")
    arguments = parser.parse_args()
    streams = -(-arguments.commands // arguments.length)
    jobs = [(arguments.seed + at, min(_AT_ONCE, streams - at), arguments.length) for at in range(0, streams, _AT_ONCE)]
    began, lived, total, unsafe = time.perf_counter(), 0, Counter[str](), list[str]()
    with multiprocessing.get_context("forkserver").Pool(arguments.workers) as pool:
        for count, counted, found in pool.imap_unordered(_many, jobs):
            lived, total, unsafe = lived + count, total + counted, unsafe + found
            print("".join(f"\r{one}\n" for one in found) + f"\r{lived * arguments.length} commands", end="", flush=True)
            if time.perf_counter() - began > arguments.minutes * 60.0:
                break
    seconds, sent = time.perf_counter() - began, total.pop("sent")
    print(f"\r{lived} streams, {lived * arguments.length} commands, {sent} sent, {len(unsafe) or 'none'} unsafe")
    for kind, number in total.most_common():
        print(f"  {kind:12s} {number}")
    print(f"{seconds:.0f} s")
    sys.exit(1 if unsafe else 0)


if __name__ == "__main__":
    main()
