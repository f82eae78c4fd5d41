"""Values that a fit leaves at neutral until the others are found: how far a load is beside its link's line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.simulation.made import Motion, recorded
from twin_daemon.diagnosis.candidates import candidate
from twin_daemon.diagnosis.fit import Fit
from twin_daemon.diagnosis.group import look
from twin_daemon.effects import LIBRARY
from twin_daemon.estimation.partition import Reduction
from twin_daemon.hand import load_hand
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.submodel import drive_groups
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

MASS_KG = 0.5
_MODEL = """<mujoco model="link"><compiler angle="radian"/>
<option timestep="0.002" integrator="implicitfast"/><worldbody>
<body name="link"><joint name="joint" axis="0 1 0" range="-2 2" damping="2" armature="0.1"/>
<geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="1" contype="0" conaffinity="0"/></body></worldbody>
<actuator><position name="joint" joint="joint" kp="100" kv="3" ctrlrange="-2 2"/></actuator></mujoco>"""
_MOTION: Motion = {
    "joint": ([0.0, 0.5, 1.5, 2.0, 2.1, 3.0, 3.3, 4.0, 5.0, 6.0], [0.0, 0.0, 1.5, 1.5, 0.6, 0.6, -1.5, -1.5, 1.0, 0.0])
}


def _fitted(folder: Path, **planted: float) -> Fit:
    """A load fitted to a link that carries one of these values."""
    path = folder / "link.xml"
    path.write_text(_MODEL)
    twin = TwinModel.load(load_hand(model=path))
    load = EffectTerm(effect="payload", target="joint", values={"mass": MASS_KG, "at": 1.0, **planted})
    plant = twin.changed(Terms(effects=(load,)))
    made = align(twin, recorded(plant, _MOTION, np.random.default_rng(3), seconds=6.0, noise_rad=1e-4))
    (group,) = drive_groups(twin)
    reduced = Reduction(twin, [made], [made]).of(twin, group, group.joints)
    assert reduced is not None
    _, part = look(reduced)
    hypothesis = candidate(LIBRARY["payload"], "joint", part.twin, "joint")
    problem = part.problem_with((hypothesis, {"mass": 0.3, "at": 1.0}))
    return part.ended(hypothesis, problem, problem.start_from(part.base.nuisances), 60)


def _free(fit: Fit) -> set[str]:
    return {variable.parameter for _, variable in fit.own_variables}


def test_a_load_on_its_line_needs_no_place_beside_it(tmp_path: Path) -> None:
    fit = _fitted(tmp_path)
    assert not {"across_1", "across_2"} & _free(fit)
    assert fit.values["mass"] == pytest.approx(MASS_KG, rel=0.02)


def test_a_load_beside_its_line_is_found_there(tmp_path: Path) -> None:
    """Where in its swing it weighs the most says how far."""
    fit = _fitted(tmp_path, across_2=0.1)
    assert {"across_1", "across_2"} <= _free(fit)
    assert (fit.problem.times_floor(fit.point) < 1.5).all()
    assert fit.values["across_2"] * fit.values["mass"] == pytest.approx(0.1 * MASS_KG, rel=0.02)
