"""The live loop against a bare echo in the same run: latency, loss, processor and memory.

python -m bench.live [--seconds 600] [--folder build/live] [--realtime]

A driver sends joint states of 24 joints over loopback and takes the answers' times. The daemon answers with its
prediction; the echo decodes the same bytes and encodes them again, with no model, so that their ratio says what the
twin itself costs. Phases alternate: machines are shared, and what disturbs one disturbs its neighbour. Where other
work leaves no core free, `--realtime` (it needs the right to) lets driver, daemon and echo alike run before it.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import zenoh

from bridges.zenoh.client import ask
from bridges.zenoh.session import open_client
from twin_daemon.cli.children import free_port
from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample
from twin_daemon.hand import load_hand
from twin_daemon.plant import Plant
from twin_daemon.plant.motions import rich
from twin_daemon.plant.recording import record, simulate
from twin_daemon.resources import twin_command

ECHO = """
import sys, time, zenoh
from twin_daemon.daemon import cdr
from twin_daemon.services.inbox import Inbox
from bridges.zenoh.session import open_daemon
session, _ = open_daemon(sys.argv[1])
publisher = session.declare_publisher(sys.argv[3], congestion_control=zenoh.CongestionControl.DROP)
inbox = Inbox()
subscriber = session.declare_subscriber(sys.argv[2], lambda sample: inbox.put("in", sample.payload.to_bytes()))
while True:
    for _, payload, _, _ in inbox.take(timeout_s=0.05):
        publisher.put(cdr.encode(cdr.decode(payload)))
"""
_PHASE_S = 30.0
_FAST_HZ, _USUAL_HZ = 1000.0, 125.0


class Peer:
    """A process that answers joint states, at an endpoint of its own."""

    def __init__(self, command: list[str], endpoint: str, state: Path) -> None:
        environment = {**os.environ, "TWIN_ENDPOINT": endpoint, "TWIN_STATE_DIR": str(state)}
        self.begun_s = time.monotonic()
        self.process = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)
        self.usage = psutil.Process(self.process.pid)
        session = open_client(endpoint, 20.0)
        assert session is not None, "the peer does not listen"
        self.session = session

    def close(self) -> None:
        self.session.close()
        self.process.send_signal(signal.SIGTERM)
        self.process.wait(10.0)

    def cpu_s(self) -> float:
        times = self.usage.cpu_times()
        return times.user + times.system


class Driver:
    """Sends one motion again and again at a rate, with stamps that go on, and takes the time of each answer."""

    def __init__(self) -> None:
        hand = load_hand()
        self.description = hand.description
        run = simulate(Plant(hand, seed=1), rich(hand, seconds=10.0))
        self._joints, self._position = run.joints, run.position

    def phase(self, peer: Peer, rate_hz: float, seconds: float) -> dict[str, Any]:
        """One phase: answers' delays in ms, what was lost, the peer's share of a core and its memory in MB."""
        delay_ms, share = self.delays(peer, rate_hz, seconds)
        p50, p99 = np.nanpercentile(delay_ms, [50, 99])
        return {
            "sent": len(delay_ms),
            "lost": int(np.isnan(delay_ms).sum()),
            "p50_ms": float(p50),
            "p99_ms": float(p99),
            "core_share": share,
            "memory_mb": peer.usage.memory_info().rss / 1e6,
        }

    def delays(self, peer: Peer, rate_hz: float, seconds: float) -> tuple[np.ndarray, float]:
        """(each answer's delay in ms, NaN where none came; the peer's share of a core)."""
        count, period = int(seconds * rate_hz), 1.0 / rate_hz
        sent, got = np.zeros(count), np.full(count, np.nan)
        begin_ns = time.time_ns()
        answers: list[tuple[float, zenoh.ZBytes]] = []

        def answer(sample: zenoh.Sample) -> None:
            # read after the phase: a hand on its bus takes none of the processor that the daemon runs on
            answers.append((time.perf_counter(), sample.payload))

        key = self.description.key
        subscriber = peer.session.declare_subscriber(key("twin_joint_states"), answer)
        publisher = peer.session.declare_publisher(key("joint_states"))
        time.sleep(0.5)
        cpu_s, begun = peer.cpu_s(), time.perf_counter()
        for index in range(count):
            row = self._position[int(index * period * 125.0) % len(self._position)]
            sample = JointSample(begin_ns + round(index * period * 1e9), self._joints, row)
            payload = cdr.encode(sample)
            while time.perf_counter() < begun + index * period:
                time.sleep(max(0.0, begun + index * period - time.perf_counter()))
            sent[index] = time.perf_counter()
            publisher.put(payload)
        time.sleep(0.5)
        elapsed = time.perf_counter() - begun
        share = (peer.cpu_s() - cpu_s) / elapsed
        subscriber.undeclare()
        publisher.undeclare()
        for now, payload in answers:
            index = round((cdr.decode(payload.to_bytes()).stamp_ns - begin_ns) * 1e-9 * rate_hz)
            if 0 <= index < count:
                got[index] = now
        return 1e3 * (got - sent), share


@contextlib.contextmanager
def calibrating(folder: Path) -> Iterator[None]:
    """While this lasts a calibration uses another core, at the lowest priority as the service runs it."""
    hand = load_hand()
    path = folder / "busy.mcap"
    record(Plant(hand, seed=2, spread=0.2), rich(hand, seconds=20.0), path)
    command = twin_command("calibrate", "--recording", str(path), "--search", "random")
    process = subprocess.Popen(
        ["nice", "-n", "19", *command, "--budget", "1000000"],
        env={**os.environ, "TWIN_STATE_DIR": str(folder / "busy")},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.sched_setscheduler(process.pid, os.SCHED_OTHER, os.sched_param(0))
    try:
        time.sleep(8.0)
        assert process.poll() is None, "the calibration has ended"
        yield
    finally:
        process.kill()
        process.wait()


def main() -> None:
    """Prints one line a phase and the ratios at the end; all of it as JSON in the folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0, help="of the daemon at 1 kHz, all phases together")
    parser.add_argument("--folder", type=Path, default=Path("build/live"))
    parser.add_argument("--realtime", action="store_true", help="driver, daemon and echo before all other work")
    chosen = parser.parse_args()
    if chosen.realtime:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    chosen.folder.mkdir(parents=True, exist_ok=True)
    driver, phases = Driver(), []
    key = driver.description.key
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        endpoints = [f"tcp/127.0.0.1:{free_port()}" for _ in range(2)]
        daemon = Peer(twin_command("run"), endpoints[0], folder / "state")
        stack.callback(daemon.close)
        ask(daemon.session, key("state"), 10.0)
        print(f"first answer {time.monotonic() - daemon.begun_s:.2f} s after the daemon's start")
        names = [endpoints[1], key("joint_states"), key("twin_joint_states")]
        echo = Peer([sys.executable, "-c", ECHO, *names], endpoints[1], folder / "state")
        stack.callback(echo.close)

        def phase(label: str, who: str, rate_hz: float, seconds: float) -> None:
            found = driver.phase(daemon if who == "daemon" else echo, rate_hz, seconds)
            phases.append({"phase": label, "who": who, "rate_hz": rate_hz, **found})
            figures = " ".join(f"{k} {v:.3g}" if isinstance(v, float) else f"{k} {v}" for k, v in found.items())
            print(f"{label:12} {who:7} {rate_hz:5.0f} Hz  {figures}", flush=True)

        rounds = max(1, round(chosen.seconds / _PHASE_S))
        for _ in range(rounds):
            for who in ("echo", "daemon"):
                phase("idle", who, _FAST_HZ, min(_PHASE_S, chosen.seconds))
        for who in ("echo", "daemon"):
            phase("usual rate", who, _USUAL_HZ, min(_PHASE_S, chosen.seconds))
        with calibrating(folder):
            for _ in range(max(1, rounds // 4)):
                for who in ("echo", "daemon"):
                    phase("calibrating", who, _FAST_HZ, min(_PHASE_S, chosen.seconds))
        health = ask(daemon.session, key("health"), 5.0)
    summary = _summary(phases) | {"health": health["loop"], "timing": health["timing"], "phases": phases}
    (chosen.folder / "live.json").write_text(json.dumps(summary, indent=1))
    for name, value in _summary(phases).items():
        print(f"{name}: {value:.3g}" if isinstance(value, float) else f"{name}: {value}")


def _summary(phases: list[dict[str, Any]]) -> dict[str, Any]:
    def of(label: str, who: str, what: str) -> list[Any]:
        return [p[what] for p in phases if (p["phase"], p["who"]) == (label, who)]

    def middle(label: str, who: str, what: str) -> float:
        return float(np.median(of(label, who, what)))

    return {
        "lost_at_1_khz": sum(of("idle", "daemon", "lost")),
        "sent_at_1_khz": sum(of("idle", "daemon", "sent")),
        "p99_over_echo": middle("idle", "daemon", "p99_ms") / middle("idle", "echo", "p99_ms"),
        "p99_over_undisturbed_while_calibrating": middle("calibrating", "daemon", "p99_ms")
        / middle("idle", "daemon", "p99_ms"),
        "p99_of_echo_over_undisturbed_while_calibrating": middle("calibrating", "echo", "p99_ms")
        / middle("idle", "echo", "p99_ms"),
        "lost_while_calibrating": sum(of("calibrating", "daemon", "lost")),
        "core_share_at_125_hz": middle("usual rate", "daemon", "core_share"),
        "memory_growth_mb": of("idle", "daemon", "memory_mb")[-1] - of("idle", "daemon", "memory_mb")[0],
    }


if __name__ == "__main__":
    main()
