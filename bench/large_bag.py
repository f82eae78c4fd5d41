"""A large recording dropped on the workbench: until its first curves are drawn, and until another range of it is.

python -m bench.large_bag [--minutes 10] [--keep FILE.mcap]

The recording has 24 joints at 1 kHz with positions, velocities and efforts (ten minutes are 610 MB). `--keep` writes it
there once and takes it again the next time. Beside each figure the load of the machine is said.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

import numpy as np

from tests.processes.conftest import Twin
from tests.web.browser import Browser, chromium
from tests.web.conftest import Workbench
from tests.web.tab import Tab
from twin_daemon.hand import load_hand
from twin_daemon.recordings.writer import McapWriter
from twin_daemon.simulation.twin import TwinModel

_RATE_HZ = 1000
_START_NS = 1_700_000_000_000_000_000
_COMMAND_EVERY = 8  # samples
_CURVES, _RANGE = "document.documentElement.dataset.curves", "document.documentElement.dataset.range"
_ZOOMED_S = 1.2


def written(path: Path, seconds: float) -> Path:
    """A motion of all joints, each at a frequency of its own, that the commands lead by 20 ms."""
    hand = load_hand()
    names, commands = tuple(hand.description.joints), tuple(TwinModel.load(hand).actuators)
    step_ns = 1_000_000_000 // _RATE_HZ
    pace = 0.6 + 0.05 * np.arange(len(names))
    with McapWriter(path) as bag:
        for number in range(round(seconds * _RATE_HZ)):
            stamp_ns, phase = _START_NS + number * step_ns, pace * number / _RATE_HZ
            bag.joint_states(
                stamp_ns, names, 0.3 + 0.2 * np.sin(phase), 0.2 * pace * np.cos(phase), 0.1 * np.sin(phase)
            )
            if number % _COMMAND_EVERY == 0:
                lead = pace[: len(commands)] * (number / _RATE_HZ + 0.02)
                bag.joint_commands(stamp_ns, commands, 0.3 + 0.2 * np.sin(lead))
    return path


def zoomed(tab: Tab) -> list[tuple[float, float]]:
    """Presses + until about a second is shown; (range in s, seconds until its curves are drawn) of each time."""
    tab.run("document.getElementById('joined').focus()")
    found = [(float("inf"), 0.0)]
    while found[-1][0] > _ZOOMED_S:
        before, begun = tab.run(_RANGE), time.perf_counter()
        tab.key("+")
        while tab.run(_RANGE) == before or tab.run(_CURVES) != tab.run(_RANGE):
            time.sleep(0.002)
        begin_s, end_s = map(float, tab.run(_RANGE).split())
        found.append((end_s - begin_s, time.perf_counter() - begun))
    return found[1:]


def main() -> None:
    """Prints one figure a line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--keep", type=Path, help="the recording; written where it is not there yet")
    chosen = parser.parse_args()
    program = chromium()
    assert program is not None, "no Chromium on this machine"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bag = chosen.keep or folder / "large.mcap"
        if not bag.exists():
            written(bag, 60.0 * chosen.minutes)
        print(f"recording      {bag.stat().st_size / 1e6:.0f} MB, load {os.getloadavg()[0]:.1f}", flush=True)
        os.environ["TWIN_STATE_DIR"] = str(folder / "state")
        with Twin(folder) as processes, Browser(program, folder / "browser") as browser:
            served = Workbench(processes)
            tab = browser.open(served.page)
            tab.until("document.documentElement.dataset.ready", 60.0)
            begun = time.perf_counter()
            tab.drop(bag)
            tab.until("document.getElementById('upload').innerText.includes('arrived')", 120.0)
            print(f"arrived        {time.perf_counter() - begun:.2f} s", flush=True)
            tab.until(f"{_CURVES} && document.querySelectorAll('.chart canvas').length >= 2", 180.0)
            print(f"first curves   {time.perf_counter() - begun:.2f} s, load {os.getloadavg()[0]:.1f}", flush=True)
            tab.until("document.documentElement.dataset.judged", 600.0)  # the twin is rolled out
            print(f"predicted      {time.perf_counter() - begun:.2f} s", flush=True)
            for span_s, wait_s in zoomed(tab):
                print(f"zoom           to {span_s:.2f} s: {wait_s:.3f} s")
            print(f"console        {tab.console}, load {os.getloadavg()[0]:.1f}")
            served.end()


if __name__ == "__main__":
    main()
