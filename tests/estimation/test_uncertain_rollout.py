"""Where a roll-out makes much of a small error: a servo at its limit, a joint that swings beyond its travel."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tests.simulation.made import FINGER, Motion, recorded
from twin_daemon.estimation.floor import floor_variance
from twin_daemon.estimation.partition import Reduction
from twin_daemon.estimation.posterior import Posterior
from twin_daemon.hand import Hand, load_hand
from twin_daemon.hand.schema import NominalUncertainty
from twin_daemon.simulation.alignment import Aligned, align
from twin_daemon.simulation.submodel import drive_groups
from twin_daemon.simulation.twin import TwinModel

_LINK = (
    '<body pos="{pos} 0 0"><inertial mass="{mass}" pos="0.15 0 0" diaginertia=".02 .02 .02"/>'
    '<joint name="{name}" axis="0 1 0" armature="0.1" damping="1"/>'
)
_SERVO = (
    '<general name="{name}" joint="{name}" gainprm="4500" biastype="affine" biasprm="0 -4500 -450" '
    'forcerange="-{limit} {limit}"/>'
)


def _arm(folder: Path, limit: float) -> TwinModel:
    """Two links in a plane, the upper one's servo with a limit (N m): its load alone is 21 N m."""
    path = folder / f"arm_{limit:g}.xml"
    links = _LINK.format(pos=0.0, mass=4, name="upper") + _LINK.format(pos=0.35, mass=3, name="lower")
    servos = _SERVO.format(name="upper", limit=limit) + _SERVO.format(name="lower", limit=87)
    path.write_text(
        f'<mujoco model="arm"><option timestep="0.002" integrator="implicitfast"/><worldbody>{links}</body></body>'
        f"</worldbody><actuator>{servos}</actuator></mujoco>"
    )
    return TwinModel.load(load_hand(model=path))


_TIMES = [0.0, 1.0, 1.3, 2.25, 2.55, 3.5, 3.8, 4.75, 5.05, 6.0]
_STEPS: Motion = {
    "upper": (_TIMES, [0.9, 0.9, 0.5, 0.5, 1.3, 1.3, 0.7, 0.7, 0.4, 0.4]),
    "lower": (_TIMES, [0.3, 0.3, 0.7, 0.7, -0.1, -0.1, 0.6, 0.6, 0.0, 0.0]),
}


def _part(twin: TwinModel, read: Aligned, joints: Sequence[str]) -> Posterior:
    group = next(one for one in drive_groups(twin) if set(joints) <= set(one.joints))
    reduced = Reduction(twin, [read], []).of(twin, group, joints)
    assert reduced is not None
    return Posterior(reduced.twin, reduced.train, (), reduced.joints, floor_variance(reduced.train, reduced.joints))


def test_nothing_holds_a_joint_against_its_neighbours_at_the_limit_of_its_servo(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    moved, paid = {}, {}
    for limit in (21.0, 87.0):
        arm = _arm(tmp_path, limit)
        read = align(arm, recorded(arm.at_step(5e-4), _STEPS, rng, seconds=6.0, noise_rad=1e-4))
        part = _part(arm, read, ["upper"])
        corrections = part.corrections_at(np.zeros(0))
        moved[limit] = max(float(np.sqrt(one.variance.max())) for one in corrections)
        paid[limit] = part.corrected(corrections).uncertainty_cost
        weights = np.concatenate([one.weight(part.floor) for one in corrections])
        assert 0.0 < weights.min() <= weights.max() <= 1.0
    assert moved[21.0] > 10.0 * moved[87.0]
    assert paid[21.0] > 5.0 * paid[87.0] >= 0.0  # what is not counted is not free


def test_joints_that_no_servo_holds_apart_are_not_excused(twin: TwinModel, rng: np.random.Generator) -> None:
    read = align(twin, recorded(twin, FINGER, rng))
    found = {}
    for joints in (("rh_FFJ3",), ("rh_FFJ1", "rh_FFJ2")):
        part = _part(twin, read, joints)
        found[joints] = max(float(one.variance.max()) for one in part.corrections_at(np.zeros(0)))
    assert found["rh_FFJ3",] > 0.0
    assert found["rh_FFJ1", "rh_FFJ2"] == 0.0


_SWING = (
    '<mujoco model="swing"><compiler angle="radian"/><option timestep="0.002"/>'
    '<worldbody><body><inertial mass="1" pos="0 0 -0.1" '
    'diaginertia=".01 .01 .01"/><joint name="swing" axis="0 1 0" range="-0.6 0.6" damping="0.02"/></body></worldbody>'
    '<actuator><position name="swing" joint="swing" kp="2" ctrlrange="-0.6 0.6"/></actuator></mujoco>'
)


def test_how_a_joint_comes_back_from_beyond_its_travel_is_no_effect(tmp_path: Path, rng: np.random.Generator) -> None:
    (tmp_path / "swing.xml").write_text(_SWING)
    hand = load_hand(model=tmp_path / "swing.xml")
    exact = hand.description.model_copy(update={"nominal_uncertainty": NominalUncertainty(ends=0.0)})
    steps = {"swing": ([0.0, 1.0, 1.0, 3.0, 3.0, 5.0], [0.0, 0.0, 0.5, 0.5, -0.2, -0.2])}
    left = {}
    for share, description in ((0.12, hand.description), (0.0, exact)):
        twin = TwinModel.load(Hand(description, hand.model_path))
        plant = twin.with_softer_ends(1.12).at_step(1e-4)  # a robot has no time step
        read = align(twin, recorded(plant, steps, rng, seconds=5.0, noise_rad=1e-4))
        assert read.measured.max() > 0.61
        part = _part(twin, read, ["swing"])
        corrected = part.corrected(part.corrections_at(np.zeros(0)))
        left[share] = float(corrected.times_floor(np.zeros(0)).max())
        quiet = align(twin, recorded(plant, {"swing": ([0.0, 1.0, 5.0], [0.0, 0.0, 0.2])}, rng, seconds=5.0))
        assert _part(twin, quiet, ["swing"]).corrections_at(np.zeros(0))[0].variance.max() == 0.0
    assert left[0.12] < 2.0 < 10.0 < left[0.0]
