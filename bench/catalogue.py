"""All benchmarks of `make bench`, in the order of the page."""

from __future__ import annotations

from bench import growth, speed
from bench.cluster import cluster
from bench.echo import echo
from bench.frame import Benchmark
from bench.peers import searches, sysid
from bench.rollouts import rollouts
from bench.short import second_approach

_CLOSING = "a real closing of the hand, every third stretch held out"

BENCHMARKS = (
    Benchmark(
        "second-approach",
        "`twin calibrate` (ours) and the best fit of a dissertation (theirs), in its space of 15 parameters, on a "
        "real closing of the hand.",
        second_approach,
        "All of its tables are on [a page of their own](dissertation.md).",
    ),
    Benchmark(
        "sysid",
        f"`twin calibrate` and mujoco.sysid in the second approach: the same recording ({_CLOSING}), parameters, "
        "bounds and start.",
        sysid,
        "Our time is that of all of `twin calibrate`, its time that of the optimiser alone. Tuned means the "
        "sub-model that moves, residuals in rad and scaled parameters.\n\nWhat each tells its user: mujoco.sysid "
        "gives values with intervals from the last Jacobian, which take residuals for independent; a warning where a "
        "start lies on a bound, on request one where the problem is ill-conditioned; and a report. `twin calibrate` "
        "gives values with intervals; which of them are on a bound, not identifiable or traded off with another; the "
        "error on what was held out; and the onset of commands that were not recorded.",
    ),
    Benchmark(
        "searches",
        f"Least squares of `twin calibrate` and other searches over the same objective: {_CLOSING}, second approach.",
        searches,
        "cma minimises the logarithm of the error. With its default settings it has as many roll-outs as least "
        "squares took; tuned, a population of 30 and twice as many. scikit-optimize has 60. Our time is that of all "
        "of `twin "
        "calibrate`, the others' that of the search; the runs of one search follow each other, so that times say "
        "less than elsewhere.",
    ),
    Benchmark(
        "rollouts",
        "The roll-out of all fits (ours), a loop of `mj_step` on as many threads, and `mujoco.rollout`; steps a "
        "second, so that more is better. The positions are the same, bit by bit.",
        rollouts,
    ),
    Benchmark(
        "echo",
        "The daemon with its prediction, and a bare echo over Zenoh that decodes and encodes the same messages: 24 "
        "joints at 1 kHz over loopback.",
        echo,
        "Both share the cores with the driver; all three run before other work where they have the right to. Longer: "
        "`python -m bench.live --realtime`.",
    ),
    Benchmark(
        "cluster",
        "A search on a Dask cluster on loopback (ours) and on this machine's cores (theirs), with as many workers as "
        "cores.",
        cluster,
        "On one machine a cluster can only cost; this is what handing work over costs.",
    ),
    Benchmark(
        "speed",
        "The ways in which the work is done (ours), and the plain ways to the same answers (theirs).",
        speed.speed,
        speed.READING,
    ),
    Benchmark(
        "growth",
        "What a batch of candidates costs as a fit grows.",
        growth.growth,
        growth.READING,
        growth.draw,
    ),
)
