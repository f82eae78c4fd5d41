"""Numbers and verdicts as people read them."""

from __future__ import annotations

import math

from twin_daemon.changes.answer import rivals_in_words
from twin_daemon.diagnosis.thresholds import DECISIVE_NATS
from twin_daemon.diagnosis.verdict import Diagnosis, Finding, VerdictName, in_hundred

UNKNOWN = "unknown"


def number(value: float | None, digits: int = 3) -> str:
    """Three digits are what an eye compares; unknown where there is none. Thousands are set apart."""
    if value is None or not math.isfinite(value):
        return UNKNOWN
    if 1e3 <= abs(value) < 1e7:
        return f"{value:,.0f}".replace(",", "\u202f")
    return f"{value:.{digits}g}"


def milli(value: float | None, digits: int = 3, sign: str = "") -> str:
    """Thousandths: rad as mrad, s as ms."""
    if value is None or not math.isfinite(value):
        return UNKNOWN
    return f"{1e3 * value:{sign}.{digits}g}"


def percent(value: float | None) -> str:
    if value is None or not math.isfinite(value):
        return UNKNOWN
    return f"{value:.0%}" if abs(value) < 0.995 or value >= 1.0 else f"{value:.2%}"


def root(value: float | None) -> float | None:
    """rad^2 -> rad."""
    return None if value is None or value < 0 else math.sqrt(value)


def interval(ci95: tuple[float | None, float | None] | None) -> str:
    if ci95 is None or any(end is None or not math.isfinite(end) for end in ci95):
        return UNKNOWN
    return f"{number(ci95[0])} to {number(ci95[1])}"


def bounds(lower: float | None, upper: float | None) -> str:
    return UNKNOWN if lower is None and upper is None else f"{number(lower)} to {number(upper)}"


def how_sure(finding: Finding, verdict: VerdictName) -> str:
    """The certainty of one finding under the verdict on all of them, and what it rests on."""
    low, high = finding.holdout_gain_ci95
    probable = "" if finding.probability is None else f"Its probability is {in_hundred(finding.probability)}. "
    said = (
        f"On validation data, to which it was not fitted, the error falls by {percent(finding.holdout_gain)} "
        f"(95 % interval {percent(low)} to {percent(high)}). {probable}Its evidence over the model without it is "
        f"{number(finding.evidence_nats, 4)} nats; a difference of {DECISIVE_NATS:g} decides between two candidates."
    )
    if finding.confusable_with:
        return f"Not sure which: these data do not tell it from {rivals_in_words(finding.confusable_with)}. {said}"
    if verdict == "unexplained":
        return f"It helps, but do not take it for the whole cause: something is left that it does not explain. {said}"
    if low > 0 and finding.evidence_nats > DECISIVE_NATS:
        return f"Sure, as far as these data go: no other candidate explains them as well. {said}"
    return f"Weak: the gain on validation data, or the evidence, may be chance. {said}"


def left_over(diagnosis: Diagnosis) -> list[str]:
    """What each part of the hand leaves, in multiples of what a right model would leave."""
    lines = []
    for name, part in diagnosis.parts.items():
        start = f"{name}: {number(part.times_floor)} times the floor at the start"
        end = f"{number(part.left_times_floor)} times what a right model leaves on validation data in the end"
        lines.append(f"{start}: within the floor, nothing was searched" if part.within_floor else f"{start}, and {end}")
    return lines
