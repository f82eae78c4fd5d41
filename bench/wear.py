"""Weeks of wear, compressed: a twin that follows, one that is calibrated anew each week, and one that never is.

    python -m bench.wear --page docs/wear.md

A finger's friction grows, its tendon stretches, then slack appears as backlash. Each week it is recorded once; the twin
that follows is recalibrated from its own last version, as the daemon does. Errors are on other motion of the same week.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.picture import picture
from twin_daemon.comparison.compare import compare_recording, mean_over_moving, pooled
from twin_daemon.figures.style import MEASURED, REFERENCE, RESIDUAL, TWIN
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


@dataclass(frozen=True)
class Week:
    """One line of the table; errors in rad^2."""

    week: int
    hidden: tuple[str, ...]
    follows_rad2: float
    anew_rad2: float
    never_rad2: float
    appeared: tuple[str, ...]
    decided: str
    took_s: float

    def line(self) -> str:
        follow, anew, left = self.follows_rad2, self.anew_rad2, self.never_rad2
        cells = [self.week, ", ".join(self.hidden) or "nothing", f"{follow:.2g}", f"{anew:.2g}", f"{follow / anew:.2g}"]
        cells += [f"{left:.2g}", f"{left / follow:.0f}", ", ".join(self.appeared) or "-", self.decided]
        return "| " + " | ".join(map(str, [*cells, f"{self.took_s:.0f}"])) + " |"


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
    rows: list[Week] = []
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
            follow, anew, left = (error(twin, later) for twin in (follows, fresh.twin, never))
            decided = "promoted" if found.decision.better else "kept: " + "; ".join(found.decision.against)
            rows.append(Week(week, hidden, follow, anew, left, tuple(found.appeared), decided, took_s))
            print(rows[-1].line(), flush=True)
    if arguments.page:
        draw(rows, arguments.page.parent / "pictures" / "wear.svg")
        lines = "\n".join(row.line() for row in rows)
        arguments.page.write_text(_PAGE.replace("LINES", lines), encoding="utf-8")


def draw(rows: Sequence[Week], path: Path) -> None:
    """The errors of the three twins by week, and under them how they compare."""
    weeks = [row.week for row in rows]
    with picture(path, rows=2, height=6.0) as (above, below):
        above.plot(weeks, [row.never_rad2 for row in rows], ":o", color=REFERENCE, label="never recalibrated")
        above.plot(weeks, [row.anew_rad2 for row in rows], "--s", color=RESIDUAL, label="calibrated anew each week")
        above.plot(weeks, [row.follows_rad2 for row in rows], "-D", color=TWIN, label="follows")
        above.set(yscale="log", ylabel="error, rad²", title="A finger wears: errors on motion that no fit has seen")
        gained = [row.never_rad2 / row.follows_rad2 for row in rows]
        below.plot(weeks, gained, ":o", color=REFERENCE, label="never / follows")
        behind = [row.follows_rad2 / row.anew_rad2 for row in rows]
        below.plot(weeks, behind, "-D", color=TWIN, label="follows / anew")
        below.axhline(2.0, color=MEASURED, linewidth=1.0, label="twice")
        below.set(yscale="log", ylabel="ratio", xlabel="week")


_PAGE = """# Weeks of wear

Made by `python -m bench.wear --page docs/wear.md`. A finger of the stand-in hand wears from week to week; each week it
is recorded for 16 s. Three twins are compared: one *follows* (recalibrated from its own last version), one is
calibrated *anew* from the nominal model, and one is *never* recalibrated after week 0. Errors are in rad², on
validation data: other motion of the same week. When wear is named, and how often wrongly, is on a page of its own:
[weeks of wear, named](wear-named.md).

![errors and their ratios by week](pictures/wear.svg)

| week | worn by | follows | anew | ratio | never | never / follows | named as appeared | decision | s |
|---|---|---|---|---|---|---|---|---|---|
LINES
"""


if __name__ == "__main__":
    main()
