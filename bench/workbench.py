"""What the workbench costs the daemon's loop, and how often its live charts are drawn.

python -m bench.workbench [--seconds 10] [--rounds 2] [--rates 125 1000] [--realtime] [--core N]

Phases alternate: the daemon alone, with a workbench that nobody looks at, and with a browser on its live view, the
hand in space beside the charts. The browser is a headless Chromium without a graphics card; its heap is that after a
collection, in the middle and at the end of its phase. `--realtime` (it needs the right to) puts driver and daemon
before all other work, the workbench and the browser not. `--core` keeps both on one core, as `CPUAffinity` of a unit
does; workbench and browser have all of them. Started with `nice -n -10` both have the priority of the daemon's unit.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from bench.live import Driver, Peer
from bridges.zenoh.client import ask
from tests.web.browser import Browser, ChromiumTab, chromium
from twin_daemon.cli.children import free_port
from twin_daemon.resources import twin_command

_CORES = os.sched_getaffinity(0)  # before driver and daemon keep to one of them
_FRAMES, _IN_SPACE = (f"Number(document.documentElement.dataset.{name} ?? 0)" for name in ("frames", "spaceFrames"))


@contextlib.contextmanager
def workbench(endpoint: str, folder: Path) -> Iterator[tuple[str, psutil.Process]]:
    """Its address and process."""
    environment = {**os.environ, "TWIN_ENDPOINT": endpoint, "TWIN_STATE_DIR": str(folder)}
    command = twin_command("workbench", "--port", "0")
    with ordinary():
        process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        process.stdout.readline()
        yield process.stdout.readline().split()[-1], psutil.Process(process.pid)
    finally:
        process.terminate()
        process.communicate(timeout=20)


@contextlib.contextmanager
def ordinary() -> Iterator[None]:
    """What is started within has no more right to the processor than other work, and any core of the bench."""
    policy, priority, cores = os.sched_getscheduler(0), os.sched_getparam(0), os.sched_getaffinity(0)
    nice = os.getpriority(os.PRIO_PROCESS, 0)
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    os.setpriority(os.PRIO_PROCESS, 0, max(nice, 0))
    os.sched_setaffinity(0, _CORES)
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)
        os.setpriority(os.PRIO_PROCESS, 0, nice)
        os.sched_setscheduler(0, policy, priority)


class Watched(threading.Thread):
    """A tab while the main thread does something else: how often it draws, and what it keeps."""

    def __init__(self, browser: Browser, tab: ChromiumTab, seconds: float) -> None:
        super().__init__()
        self._browser, self._tab, self._seconds = psutil.Process(browser.pid), tab, seconds
        self.found: dict[str, float] = {}

    def run(self) -> None:
        before, at, used_s = self._counts(), time.perf_counter(), self._used_s()
        time.sleep(0.5 * self._seconds)
        middle = self._heap_mb()
        time.sleep(max(0.9 * self._seconds - (time.perf_counter() - at), 0.0))
        elapsed = time.perf_counter() - at
        charts, space = ((now - old) / elapsed for now, old in zip(self._counts(), before, strict=True))
        self.found = {
            "charts_a_second": charts,
            "space_a_second": space,
            "browser_core_share": (self._used_s() - used_s) / elapsed,
            "browser_ms_a_frame": 1e3 * (self._used_s() - used_s) / max(charts * elapsed, 1.0),
            "heap_middle_mb": middle,
            "heap_end_mb": self._heap_mb(),
        }

    def _used_s(self) -> float:
        """Processor time of all its processes, the one that draws among them."""
        family = [self._browser, *self._browser.children(recursive=True)]
        return sum(sum(one.cpu_times()[:2]) for one in family)

    def _counts(self) -> tuple[int, int]:
        return int(self._tab.run(_FRAMES)), int(self._tab.run(_IN_SPACE))

    def _heap_mb(self) -> float:
        self._tab.call("HeapProfiler.collectGarbage")
        return self._tab.call("Runtime.getHeapUsage")["usedSize"] / 1e6


def main() -> None:
    """Prints one line a phase, and the medians at the end."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0, help="of a phase")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--rates", type=float, nargs="+", default=[125.0, 1000.0], help="Hz")
    parser.add_argument("--realtime", action="store_true", help="driver and daemon before all other work")
    parser.add_argument("--core", type=int, help="the one core that driver and daemon run on")
    chosen = parser.parse_args()
    program = chromium()
    assert program is not None, "no Chromium on this machine"
    if chosen.realtime:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    if chosen.core is not None:
        os.sched_setaffinity(0, {chosen.core})
    driver, found = Driver(), {}
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder, endpoint = Path(name), f"tcp/127.0.0.1:{free_port()}"
        daemon = Peer(twin_command("run"), endpoint, folder / "state")
        stack.callback(daemon.close)
        ask(daemon.session, driver.description.key("state"), 20.0)

        def phase(label: str, rate_hz: float, more: dict[str, Any] | None = None) -> dict[str, Any]:
            result = driver.phase(daemon, rate_hz, chosen.seconds) | (more or {})
            found.setdefault((label, rate_hz), []).append(result)
            return result

        for number in range(chosen.rounds):
            for rate_hz in chosen.rates:
                _tell("alone", rate_hz, phase("alone", rate_hz))
                with workbench(endpoint, folder / "state") as (address, process):
                    time.sleep(2.0)
                    begun = sum(process.cpu_times()[:2]), time.perf_counter()
                    result = phase("nobody looks", rate_hz)
                    used = (sum(process.cpu_times()[:2]) - begun[0]) / (time.perf_counter() - begun[1])
                    _tell("nobody looks", rate_hz, result | {"workbench_core_share": used})
                    with contextlib.ExitStack() as looking:
                        with ordinary():
                            profile = folder / f"browser-{number}-{rate_hz:g}"
                            browser = looking.enter_context(Browser(program, profile))
                        tab = browser.open(address)
                        feeding = threading.Thread(target=driver.phase, args=(daemon, rate_hz, 8.0))
                        feeding.start()
                        tab.until(f"{_FRAMES} > 20", 60.0)
                        feeding.join()
                        tab.until(f"{_IN_SPACE} > 0", 60.0)
                        watched = Watched(browser, tab, chosen.seconds)
                        watched.start()
                        result = driver.phase(daemon, rate_hz, chosen.seconds)
                        watched.join()
                        result |= watched.found
                        found.setdefault(("browser", rate_hz), []).append(result)
                        _tell("browser", rate_hz, result)
    for (label, rate_hz), results in found.items():
        medians = {key: float(np.median([one[key] for one in results])) for key in results[0]}
        _tell(f"median, {label}", rate_hz, medians)


def _tell(label: str, rate_hz: float, result: dict[str, Any]) -> None:
    words = " ".join(f"{k} {v:.3g}" if isinstance(v, float) else f"{k} {v}" for k, v in result.items())
    print(f"{label:22} {rate_hz:5.0f} Hz  {words}", flush=True)


if __name__ == "__main__":
    main()
