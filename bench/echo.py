"""The live path against a bare echo over Zenoh that decodes and encodes the same CDR: `bench.live` in short."""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from bench.frame import Row, ratio_row
from bench.live import ECHO, Driver, Peer
from bridges.zenoh.client import ask
from twin_daemon.cli.children import free_port
from twin_daemon.resources import twin_command

_RATE_HZ = 1000.0


def echo(quick: bool, seed: int) -> Sequence[Row]:
    """Delays of answers at 1 kHz, 24 joints, phases in turn."""
    driver = Driver()
    key = driver.description.key
    seconds, rounds = (2.0, 1) if quick else (8.0, 5)
    found = {"daemon": [], "echo": []}
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        stack.enter_context(_before_other_work())
        endpoints = [f"tcp/127.0.0.1:{free_port()}" for _ in range(2)]
        daemon = Peer(twin_command("run"), endpoints[0], Path(name) / "state")
        stack.callback(daemon.close)
        ask(daemon.session, key("state"), 20.0)
        names = [endpoints[1], key("joint_states"), key("twin_joint_states")]
        bare = Peer([sys.executable, "-c", ECHO, *names], endpoints[1], Path(name) / "state")
        stack.callback(bare.close)
        for _ in range(rounds):
            for who, peer in (("echo", bare), ("daemon", daemon)):
                found[who].append(driver.phase(peer, _RATE_HZ, seconds))

    def of(who: str, what: str) -> list[float]:
        return [phase[what] for phase in found[who]]

    lost = [int(np.sum(of(who, "lost"))) for who in ("daemon", "echo")]
    sent = int(np.sum(of("daemon", "sent")))
    return [
        ratio_row("delay of an answer, median", of("daemon", "p50_ms"), of("echo", "p50_ms"), unit="ms"),
        ratio_row("delay of an answer, 99 %", of("daemon", "p99_ms"), of("echo", "p99_ms"), unit="ms"),
        Row("answers lost", lost[0], lost[1], f"of {sent}", goal="none", met=lost[0] == 0),
    ]


@contextlib.contextmanager
def _before_other_work() -> Iterator[None]:
    """Driver, daemon and echo alike before all else on the machine, where this process has the right to it."""
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    except PermissionError:
        yield
        return
    try:
        yield
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
