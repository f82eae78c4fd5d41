"""`twin versions history`: each parameter and effect over time, and when it will leave its band."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin_daemon.cli.console import emit_json, people, plain_text, require_folder
from twin_daemon.cli.options import HandName, Json, Model
from twin_daemon.tables import slim_table

if TYPE_CHECKING:
    from twin_daemon.versions.history import Promotion, Series


def history(
    parameter: Annotated[
        list[str] | None,
        typer.Option("--parameter", metavar="P...", help="Only these: a name, or a part of one such as a joint."),
    ] = None,
    covariate: Annotated[
        Path | None,
        typer.Option("--covariate", metavar="FILE.csv", help="A temperature or load by time that is not wear."),
    ] = None,
    plot: Annotated[Path | None, typer.Option("--plot", metavar="FILE.html", help="Draw the history.")] = None,
    hand: HandName = None,
    model: Model = None,
    json: Json = None,
) -> None:
    """Each parameter and each value of an effect, promotion by promotion, with intervals, and where it is heading.

    A level that grows, wanders and may jump is fitted to what was fitted: growth by week, the week of a jump, when a
    limit of the hand's description is reached. There is no trend where the growth's interval holds 0. Versions that
    were rolled back do not count.
    """
    from twin_daemon.hand import load_hand
    from twin_daemon.versions import VersionStore
    from twin_daemon.versions.covariate import read_covariate
    from twin_daemon.versions.history import history as histories
    from twin_daemon.versions.history import promotions
    from twin_daemon.versions.history_words import lifetime

    require_folder(json, plot)
    described = load_hand(hand, model)
    store = VersionStore.of(described)
    series = histories(
        store,
        parameter or (),
        limits=described.description.bands,
        covariate=None if covariate is None else read_covariate(covariate).at,
    )
    promoted = promotions(store)
    if plot is not None:
        from twin_daemon.figures.history import history_figure
        from twin_daemon.figures.style import write_page

        write_page(history_figure(store.hand, series), plot)
    _show(series, promoted, json)
    emit_json(
        json,
        {
            "hand": store.hand,
            "promotions": [{"at": p.at, "exact": p.exact, "version": p.version.id} for p in promoted],
            "parameters": {one.name: _plain(one) | {"lifetime": lifetime(one, promoted)} for one in series},
            "plot": plot,
        },
    )


def _plain(series: Series) -> dict[str, Any]:
    from twin_daemon.versions.history_words import heading

    trend, left = series.trend, series.leaves_band
    return {
        "unit": series.unit,
        "points": series.points,
        "band": series.band,
        "trend": {
            "verdict": trend.verdict,
            "samples": trend.samples,
            "slope_per_day": trend.slope_per_day,
            "slope_ci95": trend.slope_ci95,
            "wanders": trend.wanders,
            "covariate_effect": trend.covariate_effect,
        },
        "levels": series.levels,
        "jumps": series.steps,
        "leaves_band": left,
        "words": heading(series),
    }


def _show(series: Sequence[Series], promoted: Sequence[Promotion], json: str | None) -> None:
    from twin_daemon.versions.history_words import heading, lifetime

    console = people(json)
    first, last = promoted[0].at.date(), promoted[-1].at.date()
    title = f"{len(promoted)} promoted versions, {first} to {last} (UTC)"
    table = slim_table(title, ("parameter", "first", "last", "95 % interval", "unit", "trend"))
    for one in series:
        end = one.points[-1]
        interval = "unknown" if end.ci95 is None else f"{end.ci95[0]:.3g} to {end.ci95[1]:.3g}"
        values = (f"{one.points[0].value:.4g}", f"{end.value:.4g}")
        table.add_row(
            plain_text(one.name), *values, interval, plain_text(one.unit), one.trend.verdict.replace("_", " ")
        )
    console.print(table)
    for one in series:
        lived = lifetime(one, promoted)
        moves = heading(one) if one.moves else ""
        if lived or moves:
            console.print(plain_text(f"{one.name}: {'; '.join(filter(None, (lived, moves)))}"), soft_wrap=True)
