"""Promotions under a daemon at 1 kHz: what is lost, and how late the samples around them are.

    python -m bench.hot_swap [--swaps 30] [--realtime]

Two versions take turns, one every two seconds, promoted by another process as a user's command does. The same time
without promotions, before and after, says what is usual on this machine; then a recalibration runs beside it.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import os
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench.live import Driver, Peer
from bridges.zenoh.client import ask
from twin_daemon.cli.children import free_port
from twin_daemon.hand import load_hand
from twin_daemon.plant import Plant
from twin_daemon.plant.motions import rich
from twin_daemon.plant.recording import record
from twin_daemon.resources import twin_command
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import Draft, VersionStore

_RATE_HZ = 1000.0
_EVERY_S = 2.0
_BUDGET_S = 20.0


def stored(store: VersionStore, twin: TwinModel, damping: float) -> str:
    """A version that differs in one number."""
    changed = twin.changed(twin.terms.with_parameters({"rh_FFJ3.damping": damping}))
    draft = Draft(hand=store.hand, kind="calibrated", terms=changed.terms.as_json(), title=f"damping {damping:g}")
    return store.add(draft, changed.mjcf()).id


def promote(hand: str, versions: Sequence[str], count: int) -> None:
    """Promotes them in turn; a process of its own, below the driver."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    store = VersionStore(hand)
    for number in range(count):
        time.sleep(_EVERY_S)
        store.promote(versions[number % len(versions)])


def main() -> None:
    """One line a phase."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--swaps", type=int, default=30)
    parser.add_argument("--realtime", action="store_true", help="driver and daemon before all other work")
    chosen = parser.parse_args()
    if chosen.realtime:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    seconds = chosen.swaps * _EVERY_S + 1.0
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        os.environ["TWIN_STATE_DIR"] = str(folder)
        hand, driver = load_hand(), Driver()
        store, twin = VersionStore(hand.name), TwinModel.load(hand)
        versions = [stored(store, twin, damping) for damping in (0.05, 0.06)]
        store.promote(versions[1])
        daemon = Peer(twin_command("run"), f"tcp/127.0.0.1:{free_port()}", folder)
        stack.callback(daemon.close)
        ask(daemon.session, driver.description.key("state"), 10.0)
        driver.phase(daemon, _RATE_HZ, 5.0)
        usual = driver.delays(daemon, _RATE_HZ, seconds)[0]
        bound_ms = 2.0 * float(np.nanpercentile(usual, 99))
        _tell("usual", usual, bound_ms)
        spawning = multiprocessing.get_context("spawn")
        other = spawning.Process(target=promote, args=(hand.name, versions, chosen.swaps))
        other.start()
        _tell(f"{chosen.swaps} promotions", driver.delays(daemon, _RATE_HZ, seconds)[0], bound_ms)
        other.join()
        found = ask(daemon.session, driver.description.key("version"), 5.0)["id"]
        print(f"in use at the end: {'the last promoted' if found == store.aliases()['current'] else found}")
        _tell("usual again", driver.delays(daemon, _RATE_HZ, seconds)[0], bound_ms)
        path = folder / "worn.mcap"
        record(Plant(hand, seed=2, spread=0.1), rich(hand, seconds=20.0), path)
        command = ["recalibrate", "--recording", str(path), "--within", str(_BUDGET_S), "--version", "nominal"]
        began_s = time.monotonic()
        process = subprocess.Popen(
            ["nice", "-n", "15", *twin_command(*command)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        os.sched_setscheduler(process.pid, os.SCHED_OTHER, os.sched_param(0))
        _tell("a recalibration beside it", driver.delays(daemon, _RATE_HZ, seconds)[0], bound_ms)
        process.wait()
        print(f"the recalibration ended with {process.returncode} after {time.monotonic() - began_s:.0f} s")


def _tell(what: str, delay_ms: np.ndarray, bound_ms: float) -> None:
    p50, p99, most = np.nanpercentile(delay_ms, [50, 99, 100])
    late = int((delay_ms > bound_ms).sum())
    print(
        f"{what:26s} sent {len(delay_ms)} lost {int(np.isnan(delay_ms).sum())} p50 {p50:.2f} p99 {p99:.2f} "
        f"greatest {most:.2f} ms; {late} later than twice the usual p99 ({bound_ms:.2f} ms)",
        flush=True,
    )


if __name__ == "__main__":
    main()
