"""A browser that is left on the live view: an hour of data through the page, compressed in time.

With TWIN_LEFT_OPEN=3600000 in the environment it is an hour at 1 kHz, which takes 10 minutes.
"""

from __future__ import annotations

import os
import time
from typing import Any

import numpy as np
import pytest
import zenoh

from bridges.zenoh.session import session_config
from tests.processes.conftest import Twin
from tests.web.browser import Browser, ChromiumTab
from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample
from twin_daemon.hand import load_hand
from twin_daemon.web.stream import FRAMES_A_SECOND

START_NS = 1_700_000_000_000_000_000
HOUR = int(os.environ.get("TWIN_LEFT_OPEN", "36000"))  # samples; so many are three times round the ring
STEP_NS = 3_600_000_000_000 // HOUR
A_SECOND = max(3000.0, HOUR / 600.0)
SHOWN_S = 10.0


def used(tab: ChromiumTab) -> tuple[float, float, int]:
    """(heap in MB, what is on the page, points that it keeps), once the rubbish is gone."""
    tab.call("HeapProfiler.collectGarbage")
    heap = tab.call("Runtime.getHeapUsage")["usedSize"] / 1e6
    elements = tab.run("document.getElementsByTagName('*').length")
    return heap, elements, int(tab.run("document.documentElement.dataset.points"))


@pytest.mark.slow
def test_an_hour_leaves_the_page_as_it_was(workbench: Any, processes: Twin, browser: Browser) -> None:
    description = load_hand().description
    names = tuple(description.joints)
    config = session_config("router", listen=[processes.endpoint])
    seen = []
    with zenoh.open(config) as session:
        hand, twin = (session.declare_publisher(description.key(k)) for k in ("joint_states", "twin_joint_states"))

        def put(number: int) -> None:
            stamp_ns, position = START_NS + number * STEP_NS, 0.5 + 0.5 * np.sin(0.01 * number + np.arange(len(names)))
            hand.put(cdr.encode(JointSample(stamp_ns, names, position)))
            twin.put(cdr.encode(JointSample(stamp_ns, names, position - 0.01)))

        tab = browser.open(workbench().page)
        frames = "Number(document.documentElement?.dataset.frames ?? 0)"
        number, deadline_s = 0, time.monotonic() + 60.0
        while not tab.run(frames):  # the page connects in its own time
            assert time.monotonic() < deadline_s
            put(number := number + 1)
        first, begun_s = number, time.monotonic()
        while number < first + HOUR:
            put(number := number + 1)
            if (number - first) % (HOUR // 6) == 0:
                seen.append(used(tab))
            if (ahead_s := begun_s + (number - first) / A_SECOND - time.monotonic()) > 0.02:
                time.sleep(ahead_s)
        spans = "Number(document.documentElement.dataset.spans)"
        for _ in range(40):  # at a pace at which a frame has several samples of a strip, however slow the machine
            put(number := number + 1)
            time.sleep(0.05)
        assert 0.0 < tab.until(f"{spans} > 0 && {spans}") <= SHOWN_S
        assert not tab.console
    heaps, elements, points = (np.array(column) for column in zip(*seen, strict=True))
    assert points.max() <= SHOWN_S * 1e9 / STEP_NS + FRAMES_A_SECOND * 4 * SHOWN_S, (
        "what is older than the strips is let go"
    )
    assert elements[-1] == elements[1]
    assert heaps[2:].max() < heaps[:2].max() + 2.0, heaps
