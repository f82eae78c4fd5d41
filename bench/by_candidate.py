"""How long each effect of the library takes as a candidate of a diagnosis, step by step."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from twin_daemon.cli.session import open_session
from twin_daemon.diagnosis.candidates import hypotheses
from twin_daemon.diagnosis.partfit import PartFit
from twin_daemon.diagnosis.screening import Screening
from twin_daemon.estimation.partition import Reduction
from twin_daemon.simulation.submodel import parts

Result = TypeVar("Result")
_ROUGH = 14  # roll-outs beside those of derivatives, and more of them on all motion
_FINE = 12


def seconds_by_candidate(recording: Path, finger: str = "FF") -> dict[str, tuple[float | None, ...]]:
    """Seconds of the processor by effect: looked at, rolled out, fitted roughly, fitted on all motion.

    At the first place of the finger where the effect can act; None where it has nothing to start from.
    """
    before = os.environ.get("TWIN_THREADS")
    os.environ["TWIN_THREADS"] = "1"
    try:
        return _measured(recording, finger)
    finally:
        os.environ.pop("TWIN_THREADS")
        if before is not None:
            os.environ["TWIN_THREADS"] = before


def _measured(recording: Path, finger: str) -> dict[str, tuple[float | None, ...]]:
    session = open_session(None, None)
    train = session.recordings([recording], None)
    part = next(p for p in parts(session.twin) if p.name == finger)
    moving = [n for n in part.joints if any(r.moving[session.twin.joints.index(n)] for r in train)]
    reduced = Reduction(session.twin, train, []).of(session.twin, part, moving)
    assert reduced is not None  # a recording of the suite, whose fingers touch nothing most of the time
    fit = PartFit(reduced.twin, reduced.train, reduced.joints)
    screening = Screening(fit)
    first = {h.effect.key: h for h in reversed(hypotheses(fit.twin, fit.joints, whole_hand=True))}
    found: dict[str, tuple[float | None, ...]] = {}
    for key in sorted(first):
        starts, looked_s = _timed(screening.screen, first[key])
        entered, entered_s = _timed(screening.enter, starts[0]) if starts else (None, None)
        rough, rough_s = _timed(lambda r: screening.roughly(r, _ROUGH), entered) if entered else (None, None)
        _, fine_s = _timed(lambda r: fit.finely(r, _FINE), rough) if rough else (None, None)
        found[key] = (looked_s, entered_s, rough_s, fine_s)
    return found


def _timed(work: Callable[..., Result], given: object) -> tuple[Result, float]:
    began = time.process_time()
    return work(given), time.process_time() - began
