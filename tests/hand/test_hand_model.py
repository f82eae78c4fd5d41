"""The Shadow Hand model of this project: complete, as heavy as the real one, calm, and free to move."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from twin_daemon.hand import load_hand

STEP_S = 0.002
FINGERS = ("FF", "MF", "RF", "LF")

# kg, the maker's figures by body
MASSES = {
    "forearm": 3.0,
    "wrist": 0.1,
    "palm": 0.3,
    "lfmetacarpal": 0.03,
    "thbase": 0.01,
    "thproximal": 0.04,
    "thhub": 0.005,
    "thmiddle": 0.02,
    "thdistal": 0.016,
} | {
    f"{finger.lower()}{link}": mass
    for finger in FINGERS
    for link, mass in {"knuckle": 0.008, "proximal": 0.03, "middle": 0.017, "distal": 0.012}.items()
}


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(load_hand().model_path))


@pytest.fixture
def data(model: mujoco.MjModel) -> mujoco.MjData:
    return mujoco.MjData(model)


def run(model: mujoco.MjModel, data: mujoco.MjData, targets: dict[str, float], seconds: float) -> np.ndarray:
    """Actuator lengths (T, nu) while the targets hold."""
    for actuator, target in targets.items():
        data.actuator(actuator).ctrl[:] = target
    lengths = []
    for _ in range(round(seconds / STEP_S)):
        mujoco.mj_step(model, data)
        lengths.append(data.actuator_length.copy())
    return np.array(lengths)


def test_it_has_24_joints_20_servos_and_4_tendons(model: mujoco.MjModel) -> None:
    assert (model.nq, model.nv, model.nu, model.ntendon, model.nmesh) == (24, 24, 20, 4, 0)
    for finger in FINGERS:
        assert model.tendon(f"rh_{finger}J0").name == f"rh_{finger}J0"
        assert model.site(f"rh_{finger.lower()}tip").name
    assert model.opt.timestep == STEP_S
    assert model.opt.jacobian == mujoco.mjtJacobian.mjJAC_DENSE


def test_its_links_weigh_what_the_maker_says(model: mujoco.MjModel) -> None:
    for body, mass in MASSES.items():
        assert model.body(f"rh_{body}").mass[0] == pytest.approx(mass), body
    assert model.body_mass.sum() == pytest.approx(sum(MASSES.values()) + 5 * 0.001)


def test_the_little_finger_bends_where_its_pose_says(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    mujoco.mj_forward(model, data)
    straight = data.site("rh_lftip").xpos.copy()
    data.joint("rh_LFJ3").qpos[0] = np.pi / 2
    mujoco.mj_forward(model, data)
    knuckle = data.body("rh_lfproximal").xpos
    assert straight - knuckle == pytest.approx([0, 0, 0.096], abs=1e-9)
    assert data.site("rh_lftip").xpos - knuckle == pytest.approx([0, -0.096, 0], abs=1e-9)  # towards the palm's side


def test_nothing_touches_from_open_to_closed(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    closed = model.key("closed").qpos
    for share in np.linspace(0.0, 1.0, 41):
        data.qpos[:] = share * closed
        mujoco.mj_forward(model, data)
        assert data.ncon == 0, f"contact at {share:.3f} of the closing"


def test_the_keyframes_are_the_poses_that_they_name(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    assert not model.key("open").qpos.any()
    for finger in FINGERS:
        for joint in (f"rh_{finger}J1", f"rh_{finger}J2", f"rh_{finger}J3"):
            address = model.joint(joint).qposadr[0]
            assert model.key("closed").qpos[address] == pytest.approx(np.pi / 2, abs=2e-4)
    mujoco.mj_resetDataKeyframe(model, data, model.key("closed").id)
    mujoco.mj_forward(model, data)
    assert data.actuator_length == pytest.approx(data.ctrl)


def test_the_thumb_can_press_on_the_first_fingertip(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    pinch = {"FFJ3": 1.0, "FFJ0": 1.5, "THJ5": 0.68, "THJ4": 1.13, "THJ3": -0.07, "THJ2": -0.21, "THJ1": 0.21}
    run(model, data, {f"rh_A_{joint}": target for joint, target in pinch.items()}, 1.0)
    touching = {frozenset((model.geom(c.geom1).name, model.geom(c.geom2).name)) for c in data.contact}
    assert frozenset(("rh_ffdistal", "rh_thdistal")) in touching
    apart = np.linalg.norm(data.site("rh_fftip").xpos - data.site("rh_thtip").xpos)
    assert 0.003 < apart < 0.03  # they press on each other; neither goes through


@pytest.mark.parametrize(
    ("actuator", "target"),
    [
        ("rh_A_FFJ4", -0.2),
        ("rh_A_FFJ3", 0.4),
        ("rh_A_FFJ0", 0.8),
        ("rh_A_LFJ5", 0.3),
        ("rh_A_LFJ3", 0.4),
        ("rh_A_THJ5", -0.4),
        ("rh_A_THJ4", 0.4),
        ("rh_A_THJ3", 0.15),
        ("rh_A_THJ2", 0.4),
        ("rh_A_THJ1", 0.4),
        ("rh_A_WRJ1", 0.3),
        ("rh_A_WRJ2", -0.3),
    ],
)
def test_a_step_settles_at_once_and_does_not_ring(
    model: mujoco.MjModel, data: mujoco.MjData, actuator: str, target: float
) -> None:
    reached = run(model, data, {actuator: target}, 0.6)[:, model.actuator(actuator).id] / target
    assert reached.max() < 1.1
    assert abs(reached[150:] - 1.0).max() < 0.025, "not settled after 0.3 s"
    swings = np.count_nonzero(np.diff(np.sign(reached[100:] - reached[-1])[np.abs(reached[100:] - reached[-1]) > 5e-3]))
    assert swings == 0
    assert all(warning.number == 0 for warning in data.warning)


def test_targets_of_a_moving_hand_are_followed_with_a_lag_of_about_25_ms(
    model: mujoco.MjModel, data: mujoco.MjData
) -> None:
    speed = 0.5
    for actuator, low, high in (("rh_A_FFJ3", 0.018, 0.03), ("rh_A_FFJ0", 0.018, 0.03), ("rh_A_WRJ1", 0.022, 0.04)):
        mujoco.mj_resetData(model, data)
        lag_s = 0.0
        for step in range(200):
            run(model, data, {actuator: speed * step * STEP_S}, STEP_S)
            lag_s = (speed * step * STEP_S - data.actuator(actuator).length[0]) / speed
        assert low < lag_s < high, actuator


@pytest.mark.parametrize(
    ("gravity", "worst_mrad"), [((0, 0, -9.81), 3.0), ((9.81, 0, 0), 15.0), ((0, 9.81, 0), 15.0), ((0, -9.81, 0), 15.0)]
)
@pytest.mark.parametrize("pose", ["open", "closed"])
def test_gravity_pulls_the_joints_only_a_little(gravity: tuple[float, ...], worst_mrad: float, pose: str) -> None:
    model = mujoco.MjModel.from_xml_path(str(load_hand().model_path))
    model.opt.gravity[:] = gravity
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(pose).id)
    lengths = run(model, data, {}, 1.5)
    assert np.abs(lengths[-1] - data.ctrl).max() * 1e3 < worst_mrad
    assert np.abs(data.qvel).max() < 2e-2
