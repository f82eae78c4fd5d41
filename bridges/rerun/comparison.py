"""Measured, commanded, predicted and residual joints of a comparison as a Rerun recording (.rrd).

Each moving joint has `JOINT/angle/measured`, `commanded` and `predicted` (rad) and `JOINT/residual` (mrad) over the
stamps of the recording; of several recordings each has its name before. The file opens with the worst joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from twin_daemon.comparison.compare import Comparison, commanded_joints
from twin_daemon.errors import BadInput
from twin_daemon.simulation.twin import TwinModel

if TYPE_CHECKING:
    from rerun import RecordingStream
    from rerun.blueprint import Blueprint

_SHOWN = 3  # joints that the file opens with
_LOOKS = {
    "measured": (140, 147, 154),
    "commanded": (90, 97, 104),
    "predicted": (217, 72, 15),
    "residual": (25, 113, 194),
}
APPLICATION = "twin_daemon"


def require_rerun() -> None:
    """Raises BadInput where the extra is not installed."""
    try:
        import rerun  # noqa: F401
    except ImportError:
        raise BadInput(
            "the Rerun SDK is not installed", todo="Install the extra: pip install 'twin_daemon[rerun]'"
        ) from None


def write_comparison(twin: TwinModel, comparisons: Sequence[Comparison], path: Path) -> None:
    """Writes the file whole, or not at all. Raises BadInput where it cannot be written."""
    import rerun as rr

    if not path.parent.is_dir():
        raise BadInput("the folder for the file does not exist", where=path.parent, todo="Create it")
    try:
        with TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as folder:
            building = Path(folder) / path.name
            stream = rr.RecordingStream(APPLICATION)
            stream.save(building, default_blueprint=_views(comparisons))
            for comparison in comparisons:
                _add(stream, twin, comparison, _prefix(comparison, comparisons))
            stream.flush()
            stream.disconnect()
            building.replace(path)
    except OSError as error:
        raise BadInput(f"cannot be written ({error.strerror})", where=path) from None


def _add(stream: RecordingStream, twin: TwinModel, comparison: Comparison, prefix: list[str]) -> None:
    import rerun as rr

    aligned, command = comparison.aligned, commanded_joints(twin, comparison.aligned)
    stamps = aligned.recording.stamp_ns.astype("datetime64[ns]")
    for joint in _moving(comparison):
        column = aligned.joints.index(joint)
        curves = {
            "measured": aligned.measured[:, column],
            "commanded": command[:, column],
            "predicted": comparison.predicted[:, column],
            "residual": 1e3 * comparison.residual[:, column],
        }
        for name, values in curves.items():
            known = np.isfinite(values)
            if not known.any():
                continue
            entity = rr.new_entity_path([*prefix, joint, *(["residual"] if name == "residual" else ["angle", name])])
            stream.log(entity, rr.SeriesLines(colors=_LOOKS[name], names=name), static=True)
            times = rr.TimeColumn("time", timestamp=stamps[known])
            stream.send_columns(entity, indexes=[times], columns=rr.Scalars.columns(scalars=values[known]))


def _views(comparisons: Sequence[Comparison]) -> Blueprint:
    """The worst joints of the first recording below one another: angle at the left, residual at the right."""
    import rerun as rr
    import rerun.blueprint as blueprint

    first = comparisons[0]
    rows = []
    for joint in _moving(first)[:_SHOWN]:
        at = [*_prefix(first, comparisons), joint]
        angle = blueprint.TimeSeriesView(origin=rr.new_entity_path([*at, "angle"]), name=f"{joint} (rad)")
        rows.append(
            blueprint.Horizontal(
                angle,
                blueprint.TimeSeriesView(
                    origin=rr.new_entity_path([*at, "residual"]), name=f"{joint}, residual (mrad)"
                ),
            )
        )
    return blueprint.Blueprint(blueprint.Vertical(*rows), collapse_panels=True)


def _moving(comparison: Comparison) -> list[str]:
    """The joints that move, the worst first."""
    moving = [(error.mse_rad2, name) for name, error in comparison.joints.items() if error.moves]
    return [name for _, name in sorted(moving, reverse=True)]


def _prefix(comparison: Comparison, comparisons: Sequence[Comparison]) -> list[str]:
    return [comparison.aligned.recording.name] if len(comparisons) > 1 else []
