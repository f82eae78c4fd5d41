"""Weeks of wear, compressed: a twin that follows, one that is calibrated anew each week, and one that never is.

    python -m bench.wear --page docs/wear.md

A finger's friction grows, its tendon stretches, then slack appears as backlash. Each week it is recorded once; the twin
that follows is recalibrated from its own last version, as the daemon does. Errors are on other motion of the same week.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

from twin_daemon.comparison.compare import compare_recording, mean_over_moving, pooled
from twin_daemon.hand import Hand, load_hand
from twin_daemon.plant import Plant, parse_hidden
from twin_daemon.plant.motions import rich
from twin_daemon.plant.recording import record
from twin_daemon.recalibration.recalibrate import Recalibration, recalibrate
from twin_daemon.recordings import load_recording
from twin_daemon.simulation.alignment import Aligned, align
from twin_daemon.simulation.twin import TwinModel

_FINGER = ("FFJ0", "FFJ3", "FFJ4")
_SEED = 5
_SPREAD = 0.1
_WEEKS: tuple[tuple[str, ...], ...] = (
    (),
    ("viscous_friction:FFJ3=0.05",),
    ("viscous_friction:FFJ3=0.1", "tendon_elasticity:FFJ0=0.05"),
    ("viscous_friction:FFJ3=0.15", "tendon_elasticity:FFJ0=0.1"),
    ("viscous_friction:FFJ3=0.2", "tendon_elasticity:FFJ0=0.15", "backlash:FFJ4=0.04"),
    ("viscous_friction:FFJ3=0.25", "tendon_elasticity:FFJ0=0.2", "backlash:FFJ4=0.04"),
)


def recorded(hand: Hand, folder: Path, week: int) -> list[Path]:
    """A recording to fit and one of other motion, of the hand as it is in a week."""
    plant = Plant(hand, seed=_SEED, hidden=[parse_hidden(text, hand) for text in _WEEKS[week]], spread=_SPREAD)
    paths = [folder / f"{week}-{which}.mcap" for which in ("fit", "held", "later")]
    for number, (path, seconds) in enumerate(zip(paths, (16.0, 8.0, 8.0), strict=True)):
        record(plant, rich(hand, _FINGER, seconds, 10 * week + number), path, jitter_s=0.0005, seed=week)
    return paths


def error(twin: TwinModel, recording: Aligned) -> float:
    """rad^2 over the joints that move."""
    return mean_over_moving(pooled([compare_recording(twin, recording)])) or 0.0


def main() -> None:
    """One line a week, and a page with the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--page", type=Path, help="Markdown page with the table")
    parser.add_argument("--seconds", type=float, default=30.0, help="what one search may take")
    arguments = parser.parse_args()
    hand = load_hand()
    nominal = TwinModel.load(hand)
    follows = never = nominal
    promised: float | None = None
    rows = []
    with tempfile.TemporaryDirectory() as name:
        for week, hidden in enumerate(_WEEKS):
            train, held, later = (align(nominal, load_recording(p)) for p in recorded(hand, Path(name), week))

            def fit(
                twin: TwinModel, promise: float | None, train: Aligned = train, held: Aligned = held
            ) -> Recalibration:
                return recalibrate(twin, [train], [held], promised_rad2=promise, seconds=arguments.seconds)

            began_s = time.perf_counter()
            found = fit(follows, promised)
            took_s = time.perf_counter() - began_s
            if found.decision.better:
                follows, promised = found.twin, found.decision.after_rad2
            fresh = found if week == 0 else fit(nominal, None)
            if week == 0:
                never = follows
            errors = [error(twin, later) for twin in (follows, fresh.twin, never)]
            appeared = ", ".join(found.appeared) or "-"
            decided = "promoted" if found.decision.better else "kept: " + "; ".join(found.decision.against)
            hides = ", ".join(hidden) or "nothing"
            follow, anew, left = errors
            cells = [week, hides, f"{follow:.2g}", f"{anew:.2g}", f"{follow / anew:.1f}", f"{left:.2g}"]
            cells += [f"{left / follow:.0f}", appeared, decided, f"{took_s:.0f}"]
            rows.append("| " + " | ".join(map(str, cells)) + " |")
            print(rows[-1], flush=True)
    if arguments.page:
        arguments.page.write_text(_PAGE + "\n".join(rows) + "\n", encoding="utf-8")


_PAGE = """# Weeks of wear

Made by `python -m bench.wear`. A finger of the stand-in hand wears from week to week; each week it is recorded for
16 s. One twin follows (recalibrated from its own last version), one is calibrated anew from the model as it comes,
one is never recalibrated after week 0. Errors in rad² on other motion of the same week, that no fit has seen.

| week | worn by | follows | anew | ratio | never | never / follows | named as appeared | decision | s |
|---|---|---|---|---|---|---|---|---|---|
"""


if __name__ == "__main__":
    main()
