"""What the figures show of a small recording."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from typing import Any

import numpy as np
import pytest

from tests.simulation.made import FINGER, recorded
from twin_daemon.comparison.compare import Comparison, compare_recording, raw_command
from twin_daemon.comparison.conditions import CONDITIONS, errors_by_condition
from twin_daemon.comparison.dependence import dependence
from twin_daemon.effects import LIBRARY
from twin_daemon.figures.comparison import comparison_figure
from twin_daemon.figures.conditions import conditions_figure
from twin_daemon.figures.dependence import dependence_figure
from twin_daemon.figures.drawings import FOLDER, drawing
from twin_daemon.figures.overlay import overlay_figure
from twin_daemon.figures.references import references_figure
from twin_daemon.figures.style import DARK, label
from twin_daemon.figures.waterfall import waterfall_figure
from twin_daemon.hand import load_hand
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel


@pytest.fixture(scope="module")
def twin() -> TwinModel:
    return TwinModel.load(load_hand())


@pytest.fixture(scope="module")
def rubbing(twin: TwinModel) -> Comparison:
    """A joint with more dry friction than the twin knows: its residual hangs on the direction."""
    friction = EffectTerm(effect="coulomb_friction", target="rh_FFJ3", values={"friction": 0.3})
    plant = twin.changed(Terms(effects=(friction,)))
    return compare_recording(twin, align(twin, recorded(plant, FINGER, np.random.default_rng(1))))


def traces(figure: Any) -> dict[str, Any]:
    return {trace.name: trace for trace in figure.data}


def test_an_overlay_has_the_residual_below_and_what_was_commanded(twin: TwinModel, rubbing: Comparison) -> None:
    column = rubbing.aligned.joints.index("rh_FFJ3")
    drawn = traces(overlay_figure(rubbing, "rh_FFJ3", raw_command(twin, rubbing.aligned)[:, column]))
    assert list(drawn) == ["raw command", "measured", "twin", "residual"]
    gap_mrad = 1e3 * (drawn["measured"].y - drawn["twin"].y)
    assert drawn["residual"].y == pytest.approx(gap_mrad, abs=1e-3)
    assert drawn["residual"].yaxis == "y2"
    assert np.abs(drawn["residual"].y).max() == pytest.approx(1e3 * rubbing.joints["rh_FFJ3"].max_abs_rad, rel=1e-4)


def test_a_joint_that_nothing_drives_has_no_command(rubbing: Comparison) -> None:
    nothing = np.full(len(rubbing.aligned.time_s), np.nan)
    assert "raw command" not in traces(overlay_figure(rubbing, "rh_FFJ3", nothing))


def test_friction_shows_as_a_residual_that_hangs_on_the_direction(twin: TwinModel, rubbing: Comparison) -> None:
    measured = rubbing.aligned.measured[:, rubbing.aligned.joints.index("rh_FFJ3")]
    plots = dependence(twin, rubbing, "rh_FFJ3", {"what was measured": measured}, most=50)
    figure = dependence_figure(plots, "rh_FFJ3")
    assert [axis.title.text for axis in figure.select_xaxes()] == [
        "position (rad)", "velocity (rad/s)", "load (N m)", "time since a reversal (s)",
    ]  # fmt: skip
    drawn = [trace for trace in figure.data if trace.xaxis == "x"]
    points = {trace.name: trace.y for trace in drawn if trace.mode == "markers"}
    assert np.nanmedian(points["moving up"]) < 0 < np.nanmedian(points["moving down"])
    assert all(len(values) <= 50 for values in points.values())
    up, down = (trace.y for trace in drawn if trace.name == "what was measured predicts")
    assert np.nanmedian(up) < 0 < np.nanmedian(down), "a candidate that predicts what was measured has its curves"


def test_a_waterfall_falls_from_the_model_before_to_what_is_left() -> None:
    (drawn,) = waterfall_figure([("nominal", 4e-4), ("+ play", 1e-4), ("+ <b>", 0.25e-4)], 1e-6).data
    assert list(drawn.x) == ["nominal", "+ play", "+ &lt;b&gt;", "left", "sensors' noise"]
    assert list(drawn.measure) == ["absolute", "relative", "relative", "total", "absolute"]
    assert drawn.y == pytest.approx([20.0, -10.0, -5.0, 0.0, 1.0])
    assert drawn.text[3] == "5 mrad"


def test_every_effect_has_one_drawing_and_what_is_unknown_has_one_too() -> None:
    assert {path.stem for path in FOLDER.glob("*.svg")} == {*LIBRARY, "unknown"}
    for key in LIBRARY:
        root = ElementTree.fromstring(drawing(key, "a <b> & c"))
        assert (root.get("data-effect"), root.get("aria-label")) == (key, "Drawing: a <b> & c")
        assert root.get("viewBox") == "0 0 300 86"
        assert {part.tag.rpartition("}")[2] for part in root.iter()} <= {
            "svg",
            "path",
            "rect",
            "text",
            "circle",
            "ellipse",
        }
        assert not {name for part in root.iter() for name in part.attrib} & {"style", "href", "onload"}
    assert "?" in drawing("of_a_user", "theirs")


def test_the_heat_map_has_every_moving_joint_by_every_condition(rubbing: Comparison) -> None:
    errors = errors_by_condition([(rubbing.aligned, rubbing.predicted)])
    (heat,) = conditions_figure(errors).data
    assert set(heat.y) == {"rh_FFJ1", "rh_FFJ2", "rh_FFJ3"}
    assert heat.y[0] == errors[0].joint
    row, column = list(heat.y).index("rh_FFJ3"), CONDITIONS.index("moving up")
    found = next(e for e in errors if (e.joint, e.condition) == ("rh_FFJ3", "moving up"))
    assert heat.z[row][column] == pytest.approx(np.log10(found.rmse_rad))
    assert heat.text[row][column] == f"{1e3 * found.rmse_rad:.3g}"
    assert heat.customdata[row][column] == [0, found.worst_s]


def test_the_comparison_keeps_the_largest_residual(rubbing: Comparison) -> None:
    figure = comparison_figure(rubbing)
    largest = max(np.abs(trace.y).max() for trace in figure.data if trace.name == "residual")
    assert largest == pytest.approx(max(e.max_abs_rad for e in rubbing.joints.values() if e.moves))


def test_references_that_are_not_there_are_not_drawn() -> None:
    (drawn,) = references_figure({"raw command": 1e-2, "last promoted version": None, "this twin": 1e-4}).data
    assert list(drawn.y) == ["raw command", "this twin"]


def test_names_are_no_markup_of_a_figure() -> None:
    assert label("<b>x</b>&") == "&lt;b&gt;x&lt;/b&gt;&amp;"


def test_every_colour_of_a_figure_has_one_for_the_dark(twin: TwinModel, rubbing: Comparison) -> None:
    command = raw_command(twin, rubbing.aligned)[:, rubbing.aligned.joints.index("rh_FFJ3")]
    errors = errors_by_condition([(rubbing.aligned, rubbing.predicted)])
    figures = [
        overlay_figure(rubbing, "rh_FFJ3", command),
        dependence_figure(dependence(twin, rubbing, "rh_FFJ3", {"a": command, "b": command, "c": command}), "rh_FFJ3"),
        waterfall_figure([("nominal", 4e-4), ("+ play", 1e-4)], 1e-6),
        conditions_figure(errors),
        references_figure({"raw command": 1e-2, "this twin": 1e-4, "noise floor of the sensors": 1e-8}),
    ]
    used = {colour for figure in figures for colour in colours({**figure.to_plotly_json(), "layout": {}})}
    used |= {shape.fillcolor for figure in figures for shape in figure.layout.shapes}
    assert used <= DARK.keys()
    assert len(used) > 5


def colours(value: Any) -> set[str]:
    if isinstance(value, str):
        return {value} if value.startswith("#") and len(value) == 7 else set()
    if isinstance(value, dict):
        return set().union(*(colours(item) for item in value.values()))
    if isinstance(value, (list, tuple)):
        return set().union(*(colours(item) for item in value))
    return set()
