"""What one joint state costs the loop's thread, stage by stage.

python -m bench.hot_path [--samples 20000]

The real bridge, service and publishers, fed by hand: 24 joints, stamps 1 ms apart, commands at 125 Hz.
What is measured is processor time, so that a busy machine shows little; each figure holds some 0.5 us of measuring.
Samples follow each other at once here. In the daemon the loop sleeps between them and finds its caches cold: there the
stages take two to three times as long.
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

from bridges.zenoh.bridge import ZenohBridge
from bridges.zenoh.session import session_config
from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample
from twin_daemon.daemon.service import TwinService
from twin_daemon.hand import load_hand
from twin_daemon.plant import Plant
from twin_daemon.plant.motions import rich
from twin_daemon.plant.recording import simulate
from twin_daemon.services.ring import Ring
from twin_daemon.simulation.twin import TwinModel

_PERIOD_NS = 1_000_000
_COMMAND_EVERY = 8
_WARM_UP = 1000


class Stopwatch:
    """Processor time of functions by the name of their stage, in ns a call. A stage within another counts in both."""

    def __init__(self) -> None:
        self.times_ns: dict[str, list[int]] = defaultdict(list)

    def reset(self) -> None:
        for times in self.times_ns.values():
            times.clear()

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
    """A publisher that also takes the time since the sample came in."""

    def __init__(self, publisher: zenoh.Publisher, stopwatch: Stopwatch) -> None:
        self.undeclare = publisher.undeclare
        self.begun_ns = 0
        self._put = stopwatch.timed("put", publisher.put)
        self._times = stopwatch.times_ns["until the prediction is out"]

    def put(self, payload: bytes) -> None:
        self._put(payload)
        self._times.append(time.thread_time_ns() - self.begun_ns)


def _watch(stopwatch: Stopwatch, bridge: ZenohBridge) -> Callable[[JointSample], None]:
    """Puts a watch on each stage, in their order; returns what handles one joint state."""
    service, publishers = bridge.service, bridge._publishers
    stopwatch.watch("decode", cdr, "decode")
    stopwatch.watch("intake", service.intake, "accept")
    stopwatch.watch("mirror", service.mirror, "update")
    stopwatch.watch("predict", service.predictor, "advance")
    stopwatch.watch("predict: one mj_step of 2 ms", mujoco, "mj_step")
    encode = cdr.encode
    stopwatch.watch("encode", cdr, "encode")
    publisher = _Publisher(publishers["twin_joint_states"], stopwatch)
    publishers["twin_joint_states"] = publisher  # type: ignore[assignment]
    stopwatch.watch("timing", service.timing, "add")
    stopwatch.watch("residual", service.residuals, "add")
    stopwatch.watch("drift", service.drifts, "add")
    stopwatch.watch("ring", bridge._ring, "add")
    stopwatch.watch("residual as JSON, 50 Hz", service, "residual_now")
    timed = stopwatch.timed("all", bridge._handle)

    def handle(sample: JointSample) -> None:
        payload = encode(sample)
        publisher.begun_ns = time.thread_time_ns()
        timed("joint_states", payload, time.monotonic(), "hand")

    return handle


def main() -> None:
    """Prints a line a stage: how often it ran, and the least, the median and the 99th percentile in us."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
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
        stopwatch = Stopwatch()
        handle = _watch(stopwatch, bridge)
        begin_ns = time.time_ns()
        gc.collect()
        gc.freeze()
        for index in range(_WARM_UP + samples):
            if index == _WARM_UP:
                stopwatch.reset()
            stamp_ns = begin_ns + index * _PERIOD_NS
            if index % _COMMAND_EVERY == 0:
                at = index // _COMMAND_EVERY
                service.on_command(JointSample(stamp_ns, run.commands, run.command[at % len(run.command)]))
                time.sleep(0.0)  # the transport's threads get their turn
            handle(JointSample(stamp_ns, run.joints, run.position[index // _COMMAND_EVERY % len(run.position)]))
        bridge.close()
    print(f"{'stage':30} {'runs':>7} {'least':>8} {'median':>8} {'p99':>8}  us")
    for stage, times in stopwatch.times_ns.items():
        least, middle, late = np.percentile(times, [0, 50, 99]) * 1e-3
        print(f"{stage:30} {len(times):7} {least:8.1f} {middle:8.1f} {late:8.1f}")


if __name__ == "__main__":
    main()
