"""How long each effect of the library takes as a candidate of a diagnosis, step by step."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from twin_daemon.diagnosis.candidates import hypotheses
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.screening import Screening
from twin_daemon.diagnosis.thresholds import FULL_FIT_ROLLOUTS, RACE_ROLLOUTS
from twin_daemon.estimation.partition import Reduction
from twin_daemon.simulation.submodel import parts
from twin_daemon.workflows.session import open_session

Result = TypeVar("Result")


def seconds_by_candidate(recording: Path, finger: str = "FF") -> dict[str, tuple[float | None, ...]]:
    """Seconds of the processor by effect: screened, rolled out, first fit, full fit on all motion.

    At the first place of the finger where the effect can act; None where it has nothing to start from.
    """
    session = open_session(None, None)
    reduction = Reduction(session.twin, session.recordings([recording], None), [])
    part = next(p for p in parts(session.twin) if p.name == finger)
    reduced = reduction.of(session.twin, part, [name for name in part.joints if name in reduction.moving])
    assert reduced is not None  # a recording of the suite, whose fingers touch nothing most of the time
    fit = PartFit(reduced.twin, reduced.train, reduced.joints)
    screening = Screening(fit)
    first = {h.effect.key: h for h in reversed(hypotheses(fit.twin, fit.joints, whole_hand=True))}
    found: dict[str, tuple[float | None, ...]] = {}
    for key in sorted(first):
        starts, looked_s = _timed(screening.screen, first[key])
        entered, entered_s = _timed(screening.enter, starts[0]) if starts else (None, None)
        fitted, first_s = (
            _timed(lambda r: screening.first_fit(r, RACE_ROLLOUTS[-1]), entered) if entered else (None, None)
        )
        _, full_s = _timed(lambda r: fit.full_fit(r, FULL_FIT_ROLLOUTS), fitted) if fitted else (None, None)
        found[key] = (looked_s, entered_s, first_s, full_s)
    return found


def _timed(work: Callable[..., Result], given: object) -> tuple[Result, float]:
    began = time.process_time()
    return work(given), time.process_time() - began
