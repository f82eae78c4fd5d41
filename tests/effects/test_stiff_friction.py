"""Dry friction at rest is stiff, however light or strong a joint is, with armature or without."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.effects.conftest import move
from twin_daemon.effects import LIBRARY
from twin_daemon.hand import load_hand
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel


def _arm(folder: Path, *, mass_kg: float, kp: float, armature: float, damping: float) -> TwinModel:
    """One joint that lies on its side, with a servo."""
    model = folder / "arm.xml"
    model.write_text(
        f"""<mujoco model="arm"><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"
        gravity="0 0 0"/><worldbody>
        <body name="link"><joint name="joint" range="-2 2" armature="{armature}" damping="{damping}"/>
        <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.03" mass="{mass_kg}"/></body></worldbody>
        <actuator><position name="servo" joint="joint" kp="{kp}" ctrlrange="-2 2"/></actuator></mujoco>""",
        encoding="utf-8",
    )
    return TwinModel.load(load_hand(model=model))


@pytest.mark.parametrize(
    ("effect", "values"),
    [("coulomb_friction", {"friction": 0.03}), ("stribeck_friction", {"breakaway": 0.03, "velocity": 0.2})],
)
@pytest.mark.parametrize(
    ("mass_kg", "kp", "armature", "damping"),
    [(20.0, 5000.0, 0.0, 200.0), (0.05, 2.0, 0.0, 0.05), (0.05, 2.0, 0.002, 0.05), (5.0, 300.0, 0.3, 20.0)],
    ids=["an arm without armature", "a finger without", "a finger", "an arm"],
)
def test_a_joint_is_where_a_quarter_of_the_step_puts_it(
    tmp_path: Path,
    effect: str,
    values: dict[str, float],
    mass_kg: float,
    kp: float,
    armature: float,
    damping: float,
) -> None:
    """Friction of 30 mrad of the servo's error."""
    arm = _arm(tmp_path, mass_kg=mass_kg, kp=kp, armature=armature, damping=damping)
    strong = {name: value if name == "velocity" else value * kp for name, value in values.items()}
    term = EffectTerm(effect=effect, target="joint", values=LIBRARY[effect].complete(strong))

    def moved(terms: Terms, step_s: float) -> np.ndarray:
        time_s = np.arange(0.0, 5.0, step_s)
        swings = np.sin(np.pi * time_s) * (1.0 + np.sin(0.2 * np.pi * time_s))
        twin = arm.at_step(step_s).changed(terms)
        return move(twin, 0.3 + 0.4 * swings[:, None])[:: round(0.002 / step_s), 0]

    fine, rough = (moved(Terms(effects=(term,)), step_s) for step_s in (0.000125, 0.0005))
    shows = np.std(fine - moved(Terms(), 0.000125))
    assert shows > 2e-3
    assert np.std(rough - fine) < 0.1 * shows
