"""A daemon that mirrors for hours: what it keeps is bounded, and nothing else grows."""

from __future__ import annotations

import gc
import socket
import sys
import time

import psutil
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

MIB = 2**20
_WARM_UP, _MESSAGES, _PERIOD_NS = 3000, 4000, 1_000_000


def test_a_full_ring_is_all_that_a_daemon_at_1_khz_keeps() -> None:
    hand = load_hand()
    run = simulate(Plant(hand, seed=1), rich(hand, seconds=4.0))
    service = TwinService(TwinModel.load(hand), {"id": "nominal"})
    ring = Ring(300.0, MIB)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with zenoh.open(session_config("router", listen=[endpoint])) as session:
        bridge = ZenohBridge(session, service, ring=ring)
        begin_ns, fed = time.time_ns(), 0

        def feed(count: int) -> tuple[int, int]:
            """Memory in use afterwards: blocks of Python's, and bytes of the process."""
            nonlocal fed
            for index in range(fed, fed + count):
                stamp_ns = begin_ns + index * _PERIOD_NS
                row = index // 8
                if index % 8 == 0:
                    service.on_command(JointSample(stamp_ns, run.commands, run.command[row % len(run.command)]))
                state = JointSample(stamp_ns, run.joints, run.position[row % len(run.position)])
                bridge._handle("joint_states", cdr.encode(state), time.monotonic(), "hand")
            fed += count
            gc.collect()
            return sys.getallocatedblocks(), psutil.Process().memory_info().rss

        blocks, size_bytes = feed(_WARM_UP)
        assert ring.full
        blocks_then, size_then_bytes = feed(_MESSAGES)
        bridge.close()
    assert service.health()["joint_states"]["accepted"] == _WARM_UP + _MESSAGES
    assert ring.used_bytes <= MIB
    assert blocks_then - blocks < _MESSAGES // 4
    assert size_then_bytes - size_bytes < 2 * MIB
