"""A coupled pair's split has no servo: what noise hides of how fast it starts stays with it until a piece ends."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.simulation.made import Motion, recorded
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.estimation.start_errors import Whitening, with_start_errors
from twin_daemon.hand import load_hand
from twin_daemon.simulation.alignment import Aligned, align
from twin_daemon.simulation.submodel import drive_groups
from twin_daemon.simulation.twin import TwinModel

_MODEL = """<mujoco model="pair"><compiler angle="radian"/><option timestep="0.002"/><worldbody>
<body name="near_link"><joint name="near" axis="0 0 1" range="0 1.57" damping="0.0013" armature="1e-4"
frictionloss="1e-5"/><geom type="capsule" size="0.004" fromto="0 0 0 0.017 0 0" mass="0.012"/>
<body name="far_link" pos="0.017 0 0"><joint name="far" axis="0 0 1" range="0 1.57" damping="0.0012" armature="1e-4"
frictionloss="1e-5"/><geom type="capsule" size="0.002" fromto="0 0 0 0.02 0 0" mass="0.006" contype="0"
conaffinity="0"/></body></body></worldbody>
<tendon><fixed name="both"><joint joint="near" coef="1"/><joint joint="far" coef="1"/></fixed></tendon>
<actuator><position name="pair" tendon="both" kp="0.04" ctrlrange="0 3.14"/></actuator></mujoco>"""

_ONE = """<mujoco model="one"><option timestep="0.0005" integrator="implicitfast"/><worldbody><body>
<joint name="near" type="hinge" axis="0 1 0" damping="1.5" armature="0.02"/><geom type="capsule" size=".01"
fromto="0 0 0 0 0 .2" mass=".1" contype="0" conaffinity="0"/></body></worldbody>
<actuator><position name="near" joint="near" kp="30" kv="0" ctrlrange="-3 3"/></actuator></mujoco>"""

_TIMES_S = np.arange(0.0, 14.0, 0.08)
_TARGETS_RAD = 1.4 + 0.6 * np.sin(2.4 * _TIMES_S) + 0.3 * np.sin(6.1 * _TIMES_S)
_MOTION: Motion = {"pair": (_TIMES_S.tolist(), _TARGETS_RAD.tolist())}  # it never rests


Judge = Callable[[str], Reduced]


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> Judge:
    """A model of the pair as a part with a recording of the true one, read with 2 mrad of noise."""
    folder = tmp_path_factory.mktemp("pair")

    def load(xml: str) -> TwinModel:
        (folder / "pair.xml").write_text(xml)
        return TwinModel.load(load_hand(model=folder / "pair.xml"))

    made = recorded(load(_MODEL), _MOTION, np.random.default_rng(3), seconds=14.0, noise_rad=2e-3)

    def judge(xml: str) -> Reduced:
        twin = load(xml)
        (group,) = drive_groups(twin)
        reduced = Reduction(twin, [align(twin, made, None)], []).of(twin, group, group.joints)
        assert reduced is not None
        return reduced

    return judge


def _left(part: Reduced, pieces: Sequence[Aligned]) -> float:
    return float(PartFit(part.twin, pieces, part.joints, nominal=True).times_floor.max())


def test_the_true_model_leaves_the_floor_of_a_pair(judged: Judge) -> None:
    part = judged(_MODEL)
    blind = [replace(piece, start_response=None) for piece in part.train]
    assert _left(part, part.train) < 1.5
    assert _left(part, blind) > 3.0


def test_a_wrong_split_is_still_seen(judged: Judge) -> None:
    part = judged(_MODEL.replace('damping="0.0012"', 'damping="0.0006"'))
    assert _left(part, part.train) > 10.0


def test_what_is_left_is_what_a_start_that_is_drawn_at_random_leaves() -> None:
    random = np.random.default_rng(0)
    response, sigma = random.normal(size=(2, 60, 3)) * 0.01, np.array([1e-3, 2e-3, 5e-4])
    drawn = np.einsum("bs,snk->bnk", random.normal(size=(4000, 2)), response) + sigma * random.normal(
        size=(4000, 60, 3)
    )
    left = Whitening(response, sigma)(drawn) / sigma
    assert (left**2).sum(axis=(1, 2)).mean() == pytest.approx(left[0].size, rel=0.01)
    assert ((drawn / sigma) ** 2).sum(axis=(1, 2)).mean() > 10 * left[0].size


def test_a_start_that_is_uncertain_is_not_held_against_a_servo(tmp_path: Path) -> None:
    """A servo forgets in 50 ms how fast its joint went; a fine sensor shows what came of it until then."""
    (tmp_path / "one.xml").write_text(_ONE)
    twin = TwinModel.load(load_hand(model=tmp_path / "one.xml"))
    motion: Motion = {"near": (_TIMES_S.tolist(), (0.7 * _TARGETS_RAD).tolist())}
    plant = twin.at_step(5e-5)  # a robot has no time step
    made = align(twin, recorded(plant, motion, np.random.default_rng(5), seconds=14.0, noise_rad=2e-4))
    (group,) = drive_groups(twin)
    part = Reduction(twin, [made], []).of(twin, group, group.joints)
    assert part is not None
    known = _left(part, part.train)
    away = np.array([[0.02], [1.0]])
    wrong = [
        replace(
            p, start_position=p.start_position + away[0], start_velocity=p.start_velocity + away[1], start_sigma=away
        )
        for p in part.train
    ]
    blind = _left(part, [replace(piece, start_response=None) for piece in wrong])
    left = _left(part, with_start_errors(part.twin, wrong, part.joints))
    assert blind > 10.0 * known
    assert left < 1.1 * known
