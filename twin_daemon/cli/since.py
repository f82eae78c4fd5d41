"""`twin diagnose --baseline R...` and `--since VERSION|DATE`: what has changed between two sessions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from twin_daemon.cli.console import plain_text
from twin_daemon.estimation.estimate import with_unit
from twin_daemon.tables import slim_table

if TYPE_CHECKING:
    from rich.console import Console

    from twin_daemon.changes.answer import Change, Since, Valued

_MOST_LISTED = 12
_MOST_JOINTS = 2


def show(console: Console, found: Since) -> None:
    """The verdict, the changes as a table, what has not changed, and what could not be seen."""
    from twin_daemon.changes.answer import rivals_in_words

    headline = {
        "explained": "Changed: both sessions are explained with what is listed.",
        "within_noise": "Unchanged: nothing that these recordings would show has changed.",
        "ambiguous": "Changed, and more than one change explains it equally well.",
    }
    console.print(f"[bold]{headline.get(found.verdict, found.in_words)}[/]")
    console.print(f"  {plain_text(found.reason)}")
    if found.changes:
        table = slim_table(
            "what has changed", ("joint", "what", "before", "now", "change", "probability"), words=("what",)
        )
        for change in found.changes:
            table.add_row(
                plain_text(_joints(change.joints)),
                change.effect.replace("_", " "),
                _number(change.before),
                _number(change.now),
                _percent(change),
                f"{change.probability:.2f}",
            )
        console.print(table)
        for change, finding in zip(found.changes, found.findings, strict=True):
            if change.rivals:
                console.print(f"  not told apart from: {plain_text(rivals_in_words(change.rivals))}")
            console.print(f"  {plain_text(finding.explanation)}")
    if found.unchanged:
        table = slim_table("unchanged, and would have been seen", ("joint", "what", "from"), words=("what",))
        for one in found.unchanged[:_MOST_LISTED]:
            amount = with_unit(f"{one.least or 0:.2g}", one.unit)
            least = f"±{100 * (one.least_ratio - 1):.2g} %" if one.least_ratio else amount
            table.add_row(plain_text(", ".join(one.joints)), one.effect.replace("_", " "), least)
        console.print(table)
        if len(found.unchanged) > _MOST_LISTED:
            console.print(f"  and {len(found.unchanged) - _MOST_LISTED} more, in --json")
    if found.undetectable:
        named = ", ".join(f"{one.effect}:{one.joints[0]}" for one in found.undetectable[:_MOST_LISTED])
        more = f" and {len(found.undetectable) - _MOST_LISTED} more" if len(found.undetectable) > _MOST_LISTED else ""
        console.print(f"not seen by this motion: {plain_text(named)}{more}")
    for note in found.notes:
        console.print(f"note: {plain_text(note)}")


def _joints(names: tuple[str, ...]) -> str:
    """Few enough for a table; the sentence below it has all of them."""
    more = len(names) - _MOST_JOINTS
    return ", ".join(names[:_MOST_JOINTS]) + (f" and {more} more" if more > 0 else "")


def _number(value: Valued) -> str:
    return "-" if value.value != value.value else f"{value.value:.3g}"


def _percent(change: Change) -> str:
    if change.ratio.value != change.ratio.value:
        return with_unit(f"{change.now.value:.3g}", change.unit)
    low, high = change.ratio.ci95
    return f"{100 * (change.ratio.value - 1):+.0f} % ({100 * (low - 1):+.0f} to {100 * (high - 1):+.0f})"
