"""`twin compare`: the model against measurements, joint by joint."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin_daemon.cli import options
from twin_daemon.cli.console import counted, emit_json, people, plain_text, require_folder
from twin_daemon.tables import slim_table
from twin_daemon.workflows.session import open_session

if TYPE_CHECKING:
    from rich.console import Console


def command(
    recording: options.Recordings,
    hand: options.HandName = None,
    model: options.Model = None,
    version: options.VersionRef = None,
    terms: options.Terms = None,
    trajectory: options.TrajectoryRef = None,
    joint_map: options.JointMap = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="FILE.html", help="Draw measured, twin and residual.")
    ] = None,
    rrd: Annotated[
        Path | None,
        typer.Option("--rrd", metavar="FILE.rrd", help="Measured, commanded, predicted and residual joints for Rerun."),
    ] = None,
    json: options.Json = None,
) -> None:
    """Roll the twin out under the recorded commands and say where it differs from the measurement.

    The raw command and the last promoted version stand beside it as predictors to compare with, and the noise floor
    of the sensors as what no model can go below.
    """
    from twin_daemon.comparison.report import comparison_report

    require_folder(json, plot, rrd)
    if rrd is not None:
        from bridges.rerun.comparison import require_rerun

        require_rerun()
    session = open_session(hand, model, version=version, terms=terms, joint_map=joint_map)
    aligned = session.recordings(recording, trajectory)
    report, comparisons = comparison_report(session.twin, aligned, session.last_promoted(), session.region)
    report["version"] = session.version
    if plot is not None:
        from twin_daemon.figures.comparison import comparison_figure
        from twin_daemon.figures.style import write_page

        for index, comparison in enumerate(comparisons):
            page = plot if len(comparisons) == 1 else plot.with_stem(f"{plot.stem}_{index + 1}")
            write_page(comparison_figure(comparison), page)
    if rrd is not None:
        from bridges.rerun.comparison import write_comparison

        write_comparison(session.twin, comparisons, rrd)
    _show(report, json)
    emit_json(json, report)


def say_outside(console: Console, region: dict[str, Any]) -> None:
    """What of the motion a version extrapolates to."""
    from twin_daemon.comparison.region import Outside

    if region["outside"]:
        console.print("[bold]outside of what this version has seen[/]: there it extrapolates")
    for one in region["outside"]:
        console.print(f"  {plain_text(str(Outside.model_validate(one)))}")


def _show(report: dict[str, Any], json: str | None) -> None:
    console = people(json)
    if report["mse_rad2"] is None:
        console.print("No joint moves by more than 0.05 rad in this recording: there is nothing to compare.")
        return
    headings = ("joint", "mse rad²", "rmse mrad", "max mrad", "bias mrad", "lag ms", "noise mrad")
    table = slim_table(f"{report['hand']}: measured against twin", headings)
    moving = [(name, joint) for name, joint in report["joints"].items() if joint.moves]
    for name, joint in sorted(moving, key=lambda item: -item[1].mse_rad2):
        lag = "-" if joint.lag_s is None else f"{1e3 * joint.lag_s:.0f}"
        table.add_row(
            plain_text(name),
            f"{joint.mse_rad2:.3g}",
            f"{1e3 * joint.rmse_rad:.2f}",
            f"{1e3 * joint.max_abs_rad:.1f}",
            f"{1e3 * joint.bias_rad:+.1f}",
            lag,
            f"{1e3 * joint.noise_rad2**0.5:.3f}",
        )
    console.print(table)
    still = len(report["joints"]) - len(moving)
    console.print(
        f"mean over {counted(len(moving), 'moving joint')} ({still} still): [bold]{report['mse_rad2']:.4g} rad²[/]"
    )
    references = report["references"]
    for label, name in (("raw command", "raw_command"), ("last promoted version", "last_promoted")):
        value = references[name]["mse_rad2"]
        console.print(f"  {label}: " + ("none" if value is None else f"{value:.4g} rad²"))
    console.print(f"  noise floor of the sensors: {report['noise_floor_rad2']:.2g} rad²")
    say_outside(console, report["region"])
    for one in report["recordings"]:
        if one["onset_estimated"]:
            console.print(
                f"  {plain_text(one['name'])}: holds no commands; the onset is estimated at {one['onset_s']:.3f} s, "
                "so a delay of the command cannot be told from it"
            )
    dropped = {kind: count for kind, count in report["dropped"].items() if count}
    if dropped:
        console.print("  dropped: " + ", ".join(f"{count} {plain_text(kind)}" for kind, count in dropped.items()))
