"""Whoever dies while the hand moves, it comes to rest in time: kills, stops and a cut network, again and again.

    python -m bench.gate_kills --times 50

Each time a daemon, a stand-in hand and a commander are started, the commander streams a motion, and one of them is
killed (SIGKILL), stopped (SIGSTOP) or cut off. What counts is how long after the loss the last command that moved the
hand was sent: 100 ms at most, at 125 Hz and at 1 kHz. The network is cut where
the machine allows network namespaces: the hand then lives in one of its own, behind a link that is taken down.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import zenoh

from bridges.zenoh.client import ask
from bridges.zenoh.commander import Commander
from bridges.zenoh.session import open_client
from twin_daemon.cli.children import free_port
from twin_daemon.daemon import cdr
from twin_daemon.gate.settings import GateSettings
from twin_daemon.hand import load_hand
from twin_daemon.resources import twin_command
from twin_daemon.security.identity import load_keyring

_TELEOPERATE = "import sys; from bench.gate_kills import teleoperate; teleoperate(*sys.argv[1:])"
_NETNS, _OUTER, _INNER = "twinbench", "10.213.7.1", "10.213.7.2"
_HOLD_S = 0.1
SETTINGS = GateSettings()


def teleoperate(endpoint: str, keys: str) -> None:
    """Arms, then streams a slow wave until it is ended. Run as a process of its own."""
    session = open_client(endpoint, 20.0)
    assert session is not None
    commander = Commander(session, load_hand().description, load_keyring(Path(keys)), "operator")
    while not commander.ask("arm", reason="bench", lease_s=600.0)["accepted"]:
        time.sleep(0.1)
    publisher = commander.stream_to()
    began_s = time.monotonic()
    print("armed", flush=True)
    while True:
        at = time.monotonic() - began_s
        commander.stream(publisher, {"rh_FFJ3": 0.6 - 0.5 * np.cos(2.0 * at), "rh_FFJ0": 0.8 - 0.6 * np.cos(2.0 * at)})
        time.sleep(0.008)


class NothingMoves(Exception):
    """The gate has ended the motion before anything was lost; with the last events."""


class Scene:
    """The three processes, and a watcher of what is sent to the hand."""

    def __init__(self, folder: Path, port: int, host: str, netns: str | None, rate_hz: str = "125") -> None:
        self.endpoint = f"tcp/{host}:{port}"
        self._folder = folder
        environment = {**os.environ, "TWIN_ENDPOINT": self.endpoint, "TWIN_STATE_DIR": str(folder)}
        # a commander's silence is noticed by its heartbeat, not by the age of its requests
        self._environment = environment
        self.processes: dict[str, subprocess.Popen[str]] = {}
        self.moves: list[tuple[float, np.ndarray]] = []
        self.start("daemon", twin_command("run"))
        inside = ["ip", "netns", "exec", netns] if netns else []
        self.start("hand", [*inside, *twin_command("hand", "--trajectory", "none", "--rate", rate_hz)])
        keys = folder / "keys.json"
        while not keys.exists():
            time.sleep(0.02)
        session = open_client(self.endpoint, 20.0)
        assert session is not None
        self.session = session
        self._watch = session.declare_subscriber("shadow_hand/joint_commands", self._sent)
        self.start("commander", [sys.executable, "-c", _TELEOPERATE, self.endpoint, str(keys)])

    def start(self, name: str, command: list[str]) -> None:
        log = (self._folder / f"{name}.log").open("a")
        self.processes[name] = subprocess.Popen(command, env=self._environment, stdout=log, stderr=log, text=True)
        log.close()

    def _sent(self, sample: zenoh.Sample) -> None:
        command = cdr.decode(sample.payload.to_bytes())
        if not self.moves or not np.array_equal(self.moves[-1][1], command.position):
            self.moves.append((time.monotonic(), command.position))

    def moving(self) -> None:
        """Waits until the hand has been moved for a while."""
        deadline_s = time.monotonic() + 40.0
        while len(self.moves) < 60:
            if time.monotonic() > deadline_s:
                events = ask(self.session, "twin/shadow_hand/events")["events"]
                raise NothingMoves("; ".join(event["text"] for event in events[-3:]))
            time.sleep(0.02)

    def close(self) -> None:
        self._watch.undeclare()
        self.session.close()
        for process in self.processes.values():
            process.kill()
            process.wait()


def lose(scene: Scene, loss: str) -> tuple[float, float]:
    """(seconds from the loss to the last command that moved, the bound for it)."""
    what, _, how = loss.partition(" ")
    lost_s = time.monotonic()
    if what == "network":
        subprocess.run(["ip", "link", "set", "twinbench0", "down"], check=True)
    else:
        number = signal.SIGKILL if how == "killed" else signal.SIGSTOP
        os.kill(scene.processes[what].pid, number)
    bound_s = _HOLD_S
    time.sleep(bound_s + 0.7)
    if how == "stopped":
        os.kill(scene.processes[what].pid, signal.SIGCONT)
        time.sleep(0.7)
        if what == "daemon":  # what it sends when it goes on may only bring the setpoints to rest
            late = [at - lost_s for at, _ in scene.moves if at > lost_s + bound_s]
            return (0.0 if len(late) <= 10 else late[-1]), bound_s
    moved = [at - lost_s for at, _ in scene.moves if at < lost_s + bound_s + 0.6]
    return max(moved[-1], 0.0), bound_s


@contextlib.contextmanager
def namespace() -> Iterator[str | None]:
    """A network namespace with a link to it; None where the machine has none to give."""
    steps = [
        f"ip netns add {_NETNS}",
        f"ip link add twinbench0 type veth peer name twinbench1 netns {_NETNS}",
        f"ip addr add {_OUTER}/30 dev twinbench0",
        "ip link set twinbench0 up",
        f"ip -n {_NETNS} addr add {_INNER}/30 dev twinbench1",
        f"ip -n {_NETNS} link set twinbench1 up",
        f"ip -n {_NETNS} link set lo up",
    ]
    try:
        for step in steps:
            subprocess.run(step.split(), check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        subprocess.run(["ip", "netns", "del", _NETNS], capture_output=True, check=False)
        yield None
        return
    try:
        yield _NETNS
    finally:
        subprocess.run(["ip", "netns", "del", _NETNS], capture_output=True, check=False)


def latency(times: int = 500) -> tuple[list[float], dict[str, float]]:
    """Seconds from an operator's streamed target to the command on the hand's key, beside joint states at 1 kHz; and
    what a target and a turn of the gate cost."""
    with tempfile.TemporaryDirectory() as folder:
        scene = Scene(Path(folder), free_port(), "127.0.0.1", None, "1000")
        try:
            scene.moving()
            scene.processes["commander"].kill()
            commander = Commander(
                scene.session, load_hand().description, load_keyring(Path(folder) / "keys.json"), "operator"
            )
            while not commander.ask("arm", reason="bench", lease_s=600.0)["accepted"]:
                commander.ask("disarm")  # the lease of one who died while nothing moved would hold on
                time.sleep(0.1)
            assert commander.ask("move", targets={"rh_FFJ3": 0.5})["accepted"]
            while commander.ask("beat")["gate"]["moving"]:
                time.sleep(0.1)
            publisher = commander.stream_to()
            found = []
            for number in range(times):
                time.sleep(0.06)
                before, asked_s = len(scene.moves), time.monotonic()
                commander.stream(publisher, {"rh_FFJ3": 0.5 + 0.02 * (number % 2)})
                while len(scene.moves) == before and time.monotonic() < asked_s + 1.0:
                    time.sleep(0.0002)
                found.append(scene.moves[before][0] - asked_s if len(scene.moves) > before else 1.0)
                if found[-5:] == [1.0] * 5:
                    raise NothingMoves(f"the gate: {commander.status()['ended']}")
            publisher.undeclare()
            return found, commander.status()["cost"]
        finally:
            scene.close()


def _tell(delays: list[float], cost: dict[str, float]) -> None:
    half, most = 1e3 * np.quantile(delays, [0.5, 0.99])
    for what in ("request", "turn"):
        print(f"gate, {what}: p50 {cost[f'{what}_p50_s'] * 1e6:.0f}, p99 {cost[f'{what}_p99_s'] * 1e6:.0f} us")
    turn_ms = 1e3 / SETTINGS.rate_hz
    print(f"operator to hand: p50 {half:.1f}, p99 {most:.1f} ms of {len(delays)} targets; a turn is {turn_ms:.0f} ms")


def main() -> None:
    """Each loss so many times; says the worst of each against its bound."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--times", type=int, default=50, help="in all, shared between the kinds of loss")
    parser.add_argument("--rate", type=int, nargs="+", default=[125, 1000], help="joint states a second, taken in turn")
    parser.add_argument("--loopback", action="store_true", help="make no network of its own, and cut none")
    arguments = parser.parse_args()
    print(f"load average {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores")
    for _ in range(3):
        with contextlib.suppress(NothingMoves):
            _tell(*latency())
            break
    else:
        print("nothing moves beside joint states at 1 kHz: this machine is too busy to measure what a turn costs")
    losses = [f"{who} {how}" for who in ("commander", "daemon", "hand") for how in ("killed", "stopped")]
    with contextlib.nullcontext() if arguments.loopback else namespace() as netns:
        if netns is None:
            print("network: not cut" if arguments.loopback else "network: no namespace to be had here, not cut")
        else:
            losses.append("network cut")
        found: dict[str, list[float]] = defaultdict(list)
        bounds: dict[str, float] = {}
        needless = 0
        for number in range(arguments.times):
            what, rate_hz = losses[number % len(losses)], arguments.rate[number // len(losses) % len(arguments.rate)]
            loss = f"{what}, {rate_hz} Hz"
            cut = what == "network cut"
            with tempfile.TemporaryDirectory() as folder:
                if cut:
                    subprocess.run(["ip", "link", "set", "twinbench0", "up"], check=True)
                host, inside = (_OUTER, netns) if cut else ("127.0.0.1", None)
                scene = Scene(Path(folder), free_port(), host, inside, str(rate_hz))
                try:
                    scene.moving()
                    took_s, bounds[loss] = lose(scene, what)
                    found[loss].append(took_s)
                except NothingMoves as why:
                    needless += 1
                    print(f"{number + 1}: {loss}: the motion was ended before the loss: {why}", flush=True)
                    continue
                finally:
                    scene.close()
            print(f"{number + 1}: {loss}: {took_s:.3f} s, at most {bounds[loss]:.2f}", flush=True)
    late = sum(took > bounds[loss] for loss, all_of in found.items() for took in all_of)
    for loss, all_of in found.items():
        if all_of:
            print(f"{loss:26s} {len(all_of):3d} times, worst {max(all_of):.3f} s, at most {bounds[loss]:.2f} s allowed")
    print(f"{sum(map(len, found.values()))} losses, {late} too late; load average {os.getloadavg()[0]:.1f}")
    print(f"{needless} motions were ended by the gate before anything was lost")


if __name__ == "__main__":
    main()
