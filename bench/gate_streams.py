"""Random commanders against the gate: whatever is asked, what leaves the gate is within every limit.

    python -m bench.gate_streams --commands 1000000

Each stream is a life of one gate under a made-up clock: several commanders at once, with and without the right to
command, numbers that jump or are none, requests that are old, repeated or out of order, clocks that jump, a hand that
falls silent or says nonsense, somebody who sends past the gate. After every turn what was sent is held against the
limits.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from collections import Counter
from typing import Any

import numpy as np

from twin_daemon.gate.gate import Gate
from twin_daemon.gate.identity import NOBODY, Who
from twin_daemon.gate.limits import Limits
from twin_daemon.gate.preview import Preview
from twin_daemon.gate.requests import KINDS, Request
from twin_daemon.gate.sendable import Sendable
from twin_daemon.gate.settings import GateSettings
from twin_daemon.hand import load_hand
from twin_daemon.simulation.twin import TwinModel

PEOPLE = (Who("ann", "operator"), Who("bob", "operator"), Who("eve", "viewer"), NOBODY, None)
_EPS = 1e-9


class Watch:
    """Holds every command that leaves a gate against the limits, by differences of what was sent alone."""

    def __init__(self, limits: Limits, dt_s: float, preview: Preview, depth_m: float) -> None:
        self._limits, self._dt_s, self._preview, self._depth_m = limits, dt_s, preview, depth_m
        self._row = np.full(len(limits.names), np.nan)
        self._first = np.full(len(limits.names), np.nan)
        self._velocity = np.zeros(len(limits.names))
        self._stamp_ns = 0
        self.sent = 0

    def idle(self) -> None:
        """Nothing is under way: the hand may be moved by others, and the next command starts anew."""
        self._row[:] = np.nan
        self._first[:] = np.nan
        self._velocity[:] = 0.0

    def displaced(self) -> None:
        """Somebody has sent the hand elsewhere, past the gate: what overlaps from now on because of it is his doing."""
        self._first = self._row.copy()

    def turn(self, sent: Sendable | None, since_s: float, start: np.ndarray, measured: np.ndarray, look: bool) -> None:
        """One turn of the gate, `since_s` after the one before; `start` (c,) is where new commands begin."""
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
            assert (change <= self._limits.acceleration * dt_s * (1 + 1e-6) + 2 * slack).all(), "too sudden"
            self._velocity = velocity
        else:
            assert np.array_equal(row[given], before[given]), "moved in no time"
        self._first = np.where(given & ~np.isfinite(self._row), start, self._first)
        moved = not np.array_equal(row[given], before[given])
        self._row = row
        if moved and look:
            now = np.where(given, self._first, start)
            found = self._preview.along(measured, np.where(given, row, start)[None], now=now)
            assert found is None, str(found)


class Stream:
    """One life of a gate under random treatment. The same seed gives the same life."""

    def __init__(self, twin: TwinModel, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        settings = GateSettings(rate_hz=float(self.rng.choice([50.0, 125.0, 500.0])), lease_s=5.0, jump_rad=0.5)
        self.gate = Gate(twin, settings, session="s")
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

    def run(self, commands: int) -> Counter[str]:
        """So many requests, with turns of the clock between them."""
        self._hear()
        for _ in range(commands):
            self._ask()
            for _ in range(int(self.rng.integers(0, 4))):
                self._turn()
        for _ in range(200):  # whatever was under way comes to rest
            self.mute_until_s = np.inf
            self._turn()
        assert not self.gate.status(self.now_s)["moving"], "still moving with the hand silent"
        self.answers["sent"] = self.watch.sent
        return self.answers

    def _turn(self) -> None:
        rng = self.rng
        kind = rng.random()
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
        idle = not self.gate.active
        if idle:
            self.watch.idle()
        start = self.gate._start()
        sent = self.gate.turn(self.now_s, self.wall_ns)
        if idle:
            assert sent is None, "sent without being armed"
            return
        self.watch.turn(sent, since_s, start, self.pose, look=rng.random() < 0.1)
        if sent is not None:
            for name, value in zip(sent.names, sent.position, strict=True):
                driven = self.hand.description.commands[name].joints
                for joint in driven:
                    place = self.joints.index(joint)
                    self.pose[place] += 0.5 * (value / len(driven) - self.pose[place])

    def _hear(self) -> None:
        if self.now_s < self.mute_until_s:
            return
        said = self.pose.copy()
        self.heard_s[:] = self.now_s
        if self.rng.random() < 0.001:
            said[self.rng.integers(len(said))] = self.rng.choice([np.nan, 1e3])
        self.gate.measured(said, self.heard_s)

    def _ask(self) -> None:
        rng = self.rng
        status = self.gate.status(self.now_s)
        likely = {"read_only": "arm", "stopped": "release"}.get(status["mode"])
        verbs = ("target", "target", "target", "move", "trajectory", "beat", "beat", "disarm", "stop", "arm", "release")
        weights = np.array([8, 8, 8, 2, 1, 4, 4, 0.1, 0.1, 0.5, 0.2])
        verb = likely if likely and rng.random() < 0.5 else str(rng.choice(verbs, p=weights / weights.sum()))
        who = PEOPLE[0] if rng.random() < 0.8 else PEOPLE[int(rng.integers(len(PEOPLE)))]
        self.sequence += 1
        common: dict[str, Any] = {
            "session": "s" if rng.random() < 0.98 else "old",
            "sequence": self.sequence if rng.random() < 0.97 else int(rng.integers(0, self.sequence)),
            "stamp_ns": self.wall_ns + int(rng.choice([0, 0, 0, 0, 0, 0, 0, 0, 0, 10**10]) * rng.choice([-1, 1])),
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
        start = dict(zip(self.names, self.gate._start().tolist(), strict=True))
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


def _many(job: tuple[int, int, int]) -> Counter[str]:
    first, count, commands = job
    twin = TwinModel.load(load_hand())
    total: Counter[str] = Counter()
    for seed in range(first, first + count):
        try:
            total += Stream(twin, seed).run(commands)
        except AssertionError as error:
            raise AssertionError(f"stream {seed}: {error}") from error
    return total


def main() -> None:
    """Runs the streams on several processes and says what the gate answered."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--commands", type=int, default=1_000_000, help="in all")
    parser.add_argument("--length", type=int, default=200, help="commands of one stream")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0, help="of the first stream")
    arguments = parser.parse_args()
    streams = -(-arguments.commands // arguments.length)
    jobs = [(arguments.seed + at, min(50, streams - at), arguments.length) for at in range(0, streams, 50)]
    began, total = time.perf_counter(), Counter[str]()
    with multiprocessing.get_context("forkserver").Pool(arguments.workers) as pool:
        for number, counted in enumerate(pool.imap_unordered(_many, jobs), start=1):
            total += counted
            print(f"\r{number * 50 * arguments.length} commands", end="", flush=True)
    print(f"\r{streams} streams, {streams * arguments.length} commands, {total.pop('sent')} sent, none beyond a limit")
    for kind, number in total.most_common():
        print(f"  {kind:12s} {number}")
    print(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
