"""A slider of an effect by hand, until the prediction of its finger is drawn: in the browser, and of it in the server.

python -m bench.slider [--drags 20]
"""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path

import numpy as np

from tests.processes.conftest import Twin
from tests.web.browser import Browser, chromium
from tests.web.conftest import Workbench
from tests.web.test_browser import mark, open_source
from tests.web.test_tools import by_hand
from tests.web.visit import loose_finger


def main() -> None:
    """Prints medians and the slowest in ms."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drags", type=int, default=20)
    chosen = parser.parse_args()
    program = chromium()
    assert program is not None, "no Chromium on this machine"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["TWIN_STATE_DIR"] = str(folder / "state")
        bag = loose_finger(folder / "loose_finger.mcap")
        with Twin(folder) as processes, Browser(program, folder / "browser") as browser:
            served = Workbench(processes, "--recording", str(bag))
            tab = browser.open(served.page)
            tab.until(mark("ready"), 60.0)
            open_source(tab, bag.name)
            tab.until(mark("judged"), 60.0)
            waits_ms = by_hand(tab, chosen.drags)
            served.end()
    for what, column in (("drawn", waits_ms[:, 0]), ("in the server", waits_ms[:, 1])):
        print(f"{what:14} median {np.median(column):.0f} ms, least {column.min():.0f}, most {column.max():.0f}")
    print(f"load           {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
