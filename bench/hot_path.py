"""What one joint state costs the daemon's thread, stage by stage: processor time, so that a busy machine does not show.

python -m bench.hot_path [--samples 20000]

The real bridge, service and publishers, fed without the transport at 1 kHz of stamps. The times hold what it takes to
measure them, some 0.5 us a stage. A stage that runs for some samples only (a step of the model) counts where it runs.
"""

from __future__ import annotations

import argparse
import functools
import gc
import socket
import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import zenoh

from bridges import cdr
from bridges.ring import Ring
from bridges.session import session_config
from bridges.zenoh_bridge import ZenohBridge
from twin_daemon.daemon.messages import JointSample
from twin_daemon.daemon.service import TwinService
from twin_daemon.hand import load_hand
from twin_daemon.plant import Plant
from twin_daemon.plant.motions import rich
from twin_daemon.plant.recording import simulate
from twin_daemon.simulation.twin import TwinModel

_RATE_HZ, _MOTION_HZ = 1000.0, 125.0
_WARM_UP = 1000


class Stopwatch:
    """Processor time of functions by the name of their stage, in ns a call. A stage within another counts in both."""

    def __init__(self) -> None:
        self.times_ns: dict[str, list[int]] = defaultdict(list)

    def watch(self, stage: str, owner: Any, name: str) -> None:
        """Replaces a function of an object or module by one that is timed."""
        setattr(owner, name, self.timed(stage, getattr(owner, name)))

    def timed(self, stage: str, action: Callable[..., Any]) -> Callable[..., Any]:
        times, clock = self.times_ns[stage], time.thread_time_ns

        @functools.wraps(action)
        def timed(*arguments: Any, **options: Any) -> Any:
            begin = clock()
            try:
                return action(*arguments, **options)
            finally:
                times.append(clock() - begin)

        return timed


class _Publisher:
    """A publisher whose `put` can be replaced."""

    def __init__(self, publisher: zenoh.Publisher) -> None:
        self.put, self.undeclare = publisher.put, publisher.undeclare


def _watch(stopwatch: Stopwatch, bridge: ZenohBridge) -> None:
    service, publishers = bridge.service, bridge._publishers
    stopwatch.watch("decode", cdr, "decode")
    stopwatch.watch("intake", service.intake, "accept")
    stopwatch.watch("mirror", service.mirror, "update")
    stopwatch.watch("predict", service.predictor, "advance")
    stopwatch.watch("predict: mj_step", mujoco, "mj_step")
    stopwatch.watch("encode", cdr, "encode")
    publishers["twin_joint_states"] = _Publisher(publishers["twin_joint_states"])  # type: ignore[assignment]
    stopwatch.watch("put", publishers["twin_joint_states"], "put")
    stopwatch.watch("timing", service.timing, "add")
    stopwatch.watch("residual", service.residuals, "add")
    stopwatch.watch("drift", service.drifts, "add")
    stopwatch.watch("ring", bridge._ring, "add")
    stopwatch.watch("residual as JSON, 50 Hz", service, "residual_now")


def main() -> None:
    """Prints a line a stage: how often it ran, and the least, the median and the 99th percentile in us."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=20_000)
    samples = parser.parse_args().samples
    hand = load_hand()
    run = simulate(Plant(hand, seed=1), rich(hand, seconds=10.0))
    service = TwinService(TwinModel.load(hand), {"id": "nominal"})
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with zenoh.open(session_config("router", listen=[endpoint])) as session:
        bridge = ZenohBridge(session, service, ring=Ring(300.0, 128 * 2**20))
        encode, stopwatch = cdr.encode, Stopwatch()
        _watch(stopwatch, bridge)
        handle = stopwatch.timed("a joint state in all", bridge._handle)
        begin_ns = time.time_ns()
        gc.collect()
        gc.freeze()
        for index in range(-_WARM_UP, samples):
            if index == 0:
                for times in stopwatch.times_ns.values():
                    times.clear()
            at = int((index + _WARM_UP) * _MOTION_HZ / _RATE_HZ)
            stamp_ns = begin_ns + round(index * 1e9 / _RATE_HZ)
            if at % len(run.command) == 0 or at != int((index - 1 + _WARM_UP) * _MOTION_HZ / _RATE_HZ):
                command = JointSample(stamp_ns, run.commands, run.command[at % len(run.command)])
                service.on_command(command)
            state = JointSample(stamp_ns, run.joints, run.position[at % len(run.position)])
            handle("joint_states", encode(state), time.monotonic())
            # what the loop's thread would wait for is left out: the transport's threads get their turn here
            if index % 50 == 0:
                time.sleep(0.001)
        bridge.close()
    print(f"{'stage':26} {'runs':>7} {'least':>8} {'median':>8} {'p99':>8}  us")
    for stage, times in stopwatch.times_ns.items():
        least, middle, late = np.percentile(times, [0, 50, 99]) * 1e-3
        print(f"{stage:26} {len(times):7} {least:8.1f} {middle:8.1f} {late:8.1f}")


if __name__ == "__main__":
    main()
