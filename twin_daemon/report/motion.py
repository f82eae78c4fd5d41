"""One set of recordings on the page: its errors by joint and group beside the references, and its figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin_daemon.comparison.compare import (
    Comparison,
    JointError,
    compare_recording,
    raw_command,
)
from twin_daemon.comparison.conditions import ConditionError, errors_by_condition
from twin_daemon.comparison.dependence import POINTS, dependence
from twin_daemon.comparison.report import comparison_report
from twin_daemon.diagnosis.free_rollout import with_finding
from twin_daemon.diagnosis.verdict import Finding
from twin_daemon.figures.conditions import conditions_figure
from twin_daemon.figures.dependence import dependence_figure
from twin_daemon.figures.overlay import BUCKETS, overlay_figure
from twin_daemon.figures.references import NOISE_LEVEL, TWIN_LEVEL, references_figure
from twin_daemon.report.chart import Chart, chart
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel

_MOST_POINTS = 30_000
"""Of all overlays together: a megabyte, however long the recordings are."""
_FEWEST_BUCKETS = 60
_CURVES = 3  # whose extremes an overlay keeps: measured, twin, residual


@dataclass(frozen=True)
class JointRow:
    """One moving joint beside the references; errors of these are None where they do not predict it."""

    name: str
    error: JointError
    raw_rad2: float | None
    promoted_rad2: float | None


@dataclass(frozen=True)
class JointOverlay:
    """One joint of one recording with its figure."""

    joint: str
    error: JointError
    chart: Chart


@dataclass(frozen=True)
class Overlays:
    """One recording: figures that share a cursor, the worst joint first."""

    group: str
    recording: str
    onset_s: float
    onset_estimated: bool
    notes: tuple[str, ...]
    joints: tuple[JointOverlay, ...]


@dataclass(frozen=True)
class Motion:
    """Recordings of one role (`recorded` or `held out`): `report` is what `twin compare` writes of them."""

    role: str
    twin: TwinModel
    report: dict[str, Any]
    rows: tuple[JointRow, ...]
    groups: dict[str, float]
    still: int
    references: Chart
    comparisons: tuple[Comparison, ...]
    commands: tuple[np.ndarray, ...]


def motion(role: str, twin: TwinModel, recordings: Sequence[Aligned], promoted: TwinModel | None) -> Motion:
    """Compares the recordings with the twin, the raw command and the last promoted version."""
    report, comparisons = comparison_report(twin, recordings, promoted)
    before: Mapping[str, JointError] = {}
    if promoted is not None:
        before = comparison_report(promoted, recordings, None)[0]["joints"]
    commands = [raw_command(twin, c.aligned) for c in comparisons]
    joints: dict[str, JointError] = report["joints"]
    moving = sorted((name for name, e in joints.items() if e.moves), key=lambda name: -joints[name].mse_rad2)
    rows = [
        JointRow(name, joints[name], _raw(comparisons, commands, name), before[name].mse_rad2 if before else None)
        for name in moving
    ]
    levels = {
        "raw command": report["references"]["raw_command"]["mse_rad2"],
        "last promoted version": report["references"]["last_promoted"]["mse_rad2"],
        TWIN_LEVEL: report["mse_rad2"],
        NOISE_LEVEL: report["noise_floor_rad2"],
    }
    words = "Mean squared error of this twin, of the raw command, of the last promoted version, and the noise floor."
    return Motion(
        role=role,
        twin=twin,
        report=report,
        rows=tuple(rows),
        groups={name: group["mse_rad2"] for name, group in report["groups"].items()},
        still=len(joints) - len(moving),
        references=chart(f"references-{role.replace(' ', '-')}", references_figure(levels), words, legend=False),
        comparisons=tuple(comparisons),
        commands=tuple(commands),
    )


def _raw(comparisons: Sequence[Comparison], commands: Sequence[np.ndarray], joint: str) -> float | None:
    """Mean squared error (rad^2) of the raw command on one joint over the recordings in which it moves."""
    squares = []
    for comparison, command in zip(comparisons, commands, strict=True):
        if joint in comparison.joints and comparison.joints[joint].moves:
            column = comparison.aligned.joints.index(joint)
            gap = comparison.aligned.measured[:, column] - command[:, column]
            squares.append(gap[np.isfinite(gap)] ** 2)
    together = np.concatenate(squares) if squares else np.empty(0)
    return float(np.mean(together)) if together.size else None


def overlays(motions: Sequence[Motion]) -> list[Overlays]:
    """The figures of every recording of all motions; their groups are `recording-1`, `recording-2`, ..."""
    every = [(m, c, command) for m in motions for c, command in zip(m.comparisons, m.commands, strict=True)]
    curves = sum(error.moves for _, c, _ in every for error in c.joints.values())
    buckets = int(np.clip(_MOST_POINTS / (2 * _CURVES * max(curves, 1)), _FEWEST_BUCKETS, BUCKETS))
    return [_overlays(number, m.role, c, command, buckets) for number, (m, c, command) in enumerate(every, start=1)]


def _overlays(number: int, role: str, comparison: Comparison, command: np.ndarray, buckets: int) -> Overlays:
    aligned, group = comparison.aligned, f"recording-{number}"
    moving = sorted((e.mse_rad2, name) for name, e in comparison.joints.items() if e.moves)
    drawn = []
    for mse, name in reversed(moving):
        column = aligned.joints.index(name)
        figure = overlay_figure(comparison, name, command[:, column], buckets=buckets)
        words = f"{name}: measured, twin and raw command over time, rmse {1e3 * mse**0.5:.3g} mrad; the residual below."
        made = chart(f"{group}-{column}", figure, words, kind="overlay", group=group, legend=False)
        drawn.append(JointOverlay(name, comparison.joints[name], made))
    title = aligned.recording.name + (" (held out)" if role == "held out" else "")
    notes = tuple(aligned.recording.quality.notes)
    return Overlays(group, title, aligned.onset_s, aligned.onset_free, notes, tuple(drawn))


@dataclass(frozen=True)
class Conditions:
    """Where the twin fails, over all recordings; None where no joint moves."""

    heat: Chart
    worst: tuple[ConditionError, ...]
    states: tuple[tuple[str, Chart], ...]
    recordings: tuple[str, ...]


_WORST = 12
_MOST_STATE_POINTS = 12_000
"""Of all joints together: half a megabyte."""
_PLOTS, _DIRECTIONS = 4, 2
_MOST_CANDIDATES = 3


def conditions(motions: Sequence[Motion], candidates: Sequence[Finding] = ()) -> Conditions | None:
    """The heat map of joints by condition, its worst cells, and what each joint's residual depends on.

    `candidates` are findings about the twin of the motions; what they predict of their joints stands beside."""
    comparisons = [c for m in motions for c in m.comparisons]
    errors = errors_by_condition((c.aligned, c.predicted) for c in comparisons)
    if not errors:
        return None
    joints = list(dict.fromkeys(error.joint for error in errors))
    heat = chart(
        "conditions",
        conditions_figure(errors),
        "Root mean square residual in mrad of each joint (rows) under each condition (columns).",
        kind="conditions",
        legend=False,
    )
    states, most = [], max(_MOST_STATE_POINTS // (_PLOTS * _DIRECTIONS * len(joints)), 20)
    predictions: dict[tuple[str, int], Comparison] = {}
    for number, joint in enumerate(joints, start=1):
        moves = ((m.twin, c) for m in motions for c in m.comparisons if joint in c.joints and c.joints[joint].moves)
        twin, comparison = next(moves)
        column = comparison.aligned.joints.index(joint)
        predicted = {}
        for one in [one for one in candidates if joint in one.joints][:_MOST_CANDIDATES]:
            if (key := (one.name, id(comparison))) not in predictions:
                predictions[key] = compare_recording(with_finding(twin, one), comparison.aligned)
            predicted[one.name] = predictions[key].predicted[:, column]
        words = f"{joint}: residual over position, velocity, load and time since a reversal, by direction."
        figure = dependence_figure(dependence(twin, comparison, joint, predicted, min(most, POINTS)), joint)
        states.append((joint, chart(f"state-{number}", figure, words)))
    names = tuple(c.aligned.recording.name for c in comparisons)
    return Conditions(heat, tuple(errors[:_WORST]), tuple(states), names)
