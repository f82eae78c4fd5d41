"""One search on this machine's cores and on a Dask cluster on loopback with as many: what handing work over costs."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Sequence

from bench.frame import LeftOut, Row, ratio_row
from bench.real import real
from twin_daemon.calibration.calibrate import calibrate
from twin_daemon.calibration.spaces import load_space
from twin_daemon.executor import on_cluster
from twin_daemon.processor_time import thread_count


def cluster(quick: bool, seed: int) -> Sequence[Row]:
    """The same random search in both places; the results have to be the same numbers."""
    try:
        from distributed import LocalCluster
    except ImportError:
        raise LeftOut("Dask is not installed; it comes with the extra `cluster`") from None

    twin, aligned = real("hand_closing")
    space = load_space("second-approach")
    ours, theirs, same = [], [], True
    here = {"n_workers": thread_count(), "threads_per_worker": 1, "dashboard_address": ":0"}
    with contextlib.closing(LocalCluster(**here)) as workers:
        for number in range(1 if quick else 3):
            found = {}
            for where, address in (("here", None), ("there", workers.scheduler_address)):
                began = time.monotonic()
                with on_cluster(address):
                    found[where] = calibrate(twin, [aligned], [], space, "random", budget=160, seed=seed + number)
                (theirs if where == "here" else ours).append(time.monotonic() - began)
            same &= found["here"].history == found["there"].history and found["here"].terms == found["there"].terms
    return [
        ratio_row("160 candidates of four fingers, cluster over cores", ours, theirs),
        Row("the same numbers, bit by bit", float(same), unit="", goal="1", met=same),
    ]
