"""What single effects do, against figures worked out by hand."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.effects.conftest import Bench, loaded_finger, move
from twin_daemon.diagnosis.candidates import hypotheses
from twin_daemon.effects import LIBRARY
from twin_daemon.effects.base import Seen
from twin_daemon.errors import BadInput
from twin_daemon.hand import load_hand
from twin_daemon.simulation.rollout import roll_out
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel


@pytest.fixture(scope="module")
def smooth() -> TwinModel:
    """A finger without gravity and dry friction: where it rests is where the torques balance."""

    def plain(spec) -> None:
        spec.option.gravity = np.zeros(3)
        for joint in spec.joints:
            joint.frictionloss = 0.0

    return loaded_finger(plain)


def _rest(twin: TwinModel, *effects: tuple[str, str, dict[str, float]], target: float = 0.7) -> float:
    """Where J3 comes to rest, rad, with its servo at `target`."""
    terms = tuple(EffectTerm(effect=key, target=place, values=values) for key, place, values in effects)
    controls = np.zeros((1000, len(twin.actuators)))
    controls[:, twin.actuators.index("rh_FFJ3")] = target
    return float(move(twin.changed(Terms(effects=terms)), controls)[-1, twin.joints.index("rh_FFJ3")])


def _hold(twin: TwinModel, start: float, *effects: tuple[str, str, dict[str, float]], target: float = 0.7) -> float:
    """Where J3 comes to rest, rad, after a slow way from `start` to `target`."""
    terms = tuple(EffectTerm(effect=key, target=place, values=values) for key, place, values in effects)
    controls = np.zeros((1500, len(twin.actuators)))
    controls[:, twin.actuators.index("rh_FFJ3")] = np.interp(np.arange(1500), [0, 700], [start, target])
    return float(move(twin.changed(Terms(effects=terms)), controls)[-1, twin.joints.index("rh_FFJ3")])


def test_a_series_spring_adds_its_compliance_to_the_servos(smooth: TwinModel):
    pull = ("spring", "rh_FFJ3", {"stiffness": 0.0, "preload": 0.4})
    for stiffness in (5.0, 50.0, 500.0):
        shift = _rest(smooth, pull, ("tendon_elasticity", "rh_FFJ3", {"stiffness": stiffness})) - 0.7
        assert shift == pytest.approx(0.4 / 10.0 + 0.4 / stiffness, rel=1e-3)


@pytest.mark.parametrize("gap", [1e-4, 3e-4, 0.01, 0.06, 0.2])
def test_play_is_the_way_between_two_loads_beyond_what_the_servo_gives(smooth: TwinModel, gap: float):
    play = ("backlash", "rh_FFJ3", {"gap": gap})
    up, down = (_rest(smooth, ("spring", "rh_FFJ3", {"stiffness": 0.0, "preload": s * 0.2}), play) for s in (1, -1))
    ends = 2 * 0.2 / 10.0 / 1000.0
    assert up - down == pytest.approx(gap + 2 * 0.2 / 10.0 + ends, abs=min(0.05 * gap, 5e-4))


@pytest.mark.parametrize("band", [1e-4, 3e-4, 0.01])
def test_a_silent_band_is_the_way_between_two_loads_beyond_what_the_servo_gives(smooth: TwinModel, band: float):
    silence = ("dead_zone", "rh_FFJ3", {"band": band})
    up, down = (_rest(smooth, ("spring", "rh_FFJ3", {"stiffness": 0.0, "preload": s * 0.2}), silence) for s in (1, -1))
    ends = 2 * 0.2 / 10.0 / 1000.0
    assert up - down == pytest.approx(2.0 * band + 2 * 0.2 / 10.0 + ends, abs=min(0.1 * band, 5e-4))


def test_play_and_elasticity_at_one_motor_add_up(smooth: TwinModel):
    both = (("backlash", "rh_FFJ3", {"gap": 0.05}), ("tendon_elasticity", "rh_FFJ3", {"stiffness": 20.0}))
    up, down = (_rest(smooth, ("spring", "rh_FFJ3", {"stiffness": 0.0, "preload": s * 0.2}), *both) for s in (1, -1))
    assert up - down == pytest.approx(0.05 + 2 * 0.2 / 10.0 + 2 * 0.2 / 20.0, abs=5e-4)


@pytest.mark.parametrize("band", [0.005, 0.03, 0.1])
def test_a_silent_servo_lets_the_joint_rest_at_the_edge_of_its_band(smooth: TwinModel, band: float):
    silent = ("dead_zone", "rh_FFJ3", {"band": band})
    assert [0.7 - _hold(smooth, start, silent) for start in (0.4, 1.0)] == pytest.approx([band, -band], abs=1e-3)


@pytest.mark.parametrize("derivative", [-0.02, -0.2, 1.0])
def test_a_silent_servo_may_have_derivative_action(derivative: float):
    """Given as its gain, which MuJoCo has negative, or as a damping ratio."""

    def damped(spec) -> None:
        spec.option.gravity = np.zeros(3)
        for joint in spec.joints:
            joint.frictionloss = 0.0
        spec.option.timestep, spec.option.integrator = 0.004, mujoco.mjtIntegrator.mjINT_EULER
        spec.actuator("rh_A_FFJ3").biasprm[2] = derivative

    silent = ("dead_zone", "rh_FFJ3", {"band": 0.03})
    assert [0.7 - _hold(loaded_finger(damped), start, silent) for start in (0.4, 1.0)] == pytest.approx(
        [0.03, -0.03], abs=1e-3
    )


def test_holds_reached_from_both_sides_under_two_loads_tell_what_keeps_a_joint_from_its_target():
    """(how far apart the two sides, how far apart the two loads leave it), beyond the servo's own stiffness."""

    def geared(spec) -> None:
        spec.option.gravity = np.zeros(3)
        for joint in spec.joints:
            joint.frictionloss, joint.armature, joint.damping = 0.0, 0.02, np.array([1.0, 0.0, 0.0])

    finger = loaded_finger(geared)
    torque, here = 0.3, "rh_FFJ3"
    kept = {
        "dead_zone": (here, {"band": 0.03}),
        "coulomb_friction": (here, {"friction": 0.2, "sticking": 1.0}),
        "sensor_offset": (here, {"offset": 0.03}),
    }
    apart = {}
    for key, (place, values) in kept.items():
        rests = [
            [
                _hold(finger, start, ("spring", here, {"stiffness": 0.0, "preload": load}), (key, place, values))
                for start in (0.4, 1.0)
            ]
            for load in (-torque, torque)
        ]
        sides, loads = np.diff(rests, axis=1), np.diff(np.mean(rests, axis=1)) - 2 * torque / 10.0
        apart[key] = (float(np.abs(sides).mean()), float(loads[0]))
    assert apart["dead_zone"] == pytest.approx((0.0, 0.06), abs=1e-3)
    assert apart["coulomb_friction"] == pytest.approx((0.04, 0.0), abs=4e-3)
    assert apart["sensor_offset"] == pytest.approx((0.0, 0.0), abs=1e-3)


def test_a_silent_servo_is_play_behind_a_motor_that_weighs_nothing(bench: Bench):
    """The two are told apart by what a heavy motor does on its way through its play, and by nothing else."""
    silent = bench.move(bench.with_effects(("dead_zone", "rh_FFJ3", {"band": 0.04})))
    plays = [
        bench.move(bench.with_effects(("backlash", "rh_FFJ3", {"gap": 0.08, "motor_share": share})))
        for share in (0.02, 0.9)
    ]
    light, heavy = (float(np.std(play - silent)) for play in plays)
    assert light < 5e-4 < 2e-3 < heavy


@pytest.mark.parametrize(("error", "left"), [(0.02, 0.0), (0.1, 0.07), (-0.1, -0.07)])
def test_a_servo_is_silent_from_the_first_step_of_a_rollout(smooth: TwinModel, error: float, left: float):
    """It moves the joint as a servo would whose target is nearer by the band, as long as it pulls at all."""
    twin = smooth.changed(Terms(effects=(EffectTerm(effect="dead_zone", target="rh_FFJ3", values={"band": 0.03}),)))
    start = np.full(len(twin.joints), 0.5)
    moved = []
    for model, off in ((twin, error), (smooth, left)):
        control = twin.drive @ start
        control[twin.actuators.index("rh_FFJ3")] += off
        qpos = model.initial_qpos(start, control)
        moved.append(roll_out([model.model], np.tile(control, (1, 10, 1)), qpos[None])[0][:, model.qpos_adr])
    np.testing.assert_allclose(*moved, rtol=0, atol=2e-4)


def test_a_silent_servo_keeps_its_limit(smooth: TwinModel):
    """With a load beyond what the servo gives the joint runs away, band or none."""
    limit = float(smooth.base_model.actuator_forcerange[smooth.actuators.index("rh_FFJ3"), 1])
    load = ("spring", "rh_FFJ3", {"stiffness": 0.0, "preload": 0.9 * limit})
    silent = ("dead_zone", "rh_FFJ3", {"band": 0.03})
    assert _rest(smooth, load, silent, target=0.2) == pytest.approx(0.2 + 0.09 * limit + 0.03, abs=2e-3)
    beyond = ("spring", "rh_FFJ3", {"stiffness": 0.0, "preload": 1.1 * limit})
    assert _rest(smooth, beyond, silent, target=0.2) > 1.0


def test_a_spring_pulls_with_its_preload_and_its_stiffness(smooth: TwinModel):
    rest = _rest(smooth, ("spring", "rh_FFJ3", {"stiffness": 2.0, "preload": 0.5}))
    assert rest == pytest.approx((10.0 * 0.7 + 0.5) / (10.0 + 2.0), abs=1e-5)


def test_a_cubic_spring_pulls_with_the_third_power(smooth: TwinModel):
    rest = _rest(smooth, ("nonlinear_spring", "rh_FFJ3", {"cubic": 3.0, "centre": 1.2}))
    assert 10.0 * (0.7 - rest) == pytest.approx(3.0 * (rest - 1.2) ** 3, abs=1e-4)


def test_a_stop_is_a_spring_from_where_it_begins(smooth: TwinModel):
    end = smooth.base_model.joint("rh_FFJ3").range[1]
    rest = _rest(smooth, ("joint_stop", "rh_FFJ3", {"stiffness": 30.0, "upper": end - 0.5, "lower": 0.0}))
    assert rest == pytest.approx((10.0 * 0.7 + 30.0 * 0.5) / 40.0, abs=1e-5)


@pytest.mark.parametrize("coefficient", [0.03, 0.1, 0.3, 0.6])
@pytest.mark.parametrize("torque", [0.1, 1.0])
def test_the_brake_takes_its_share_of_the_torque(coefficient: float, torque: float):
    def treadmill(spec) -> None:  # a constant torque against damping alone: the speed tells the torque that is left
        spec.option.gravity = np.zeros(3)
        joint, servo = spec.joint("rh_FFJ3"), spec.actuator("rh_A_FFJ3")
        joint.frictionloss, joint.damping, joint.range = 0.0, np.array([1.0, 0.0, 0.0]), np.array([-50.0, 50.0])
        servo.forcerange, servo.ctrlrange = np.array([-torque, torque]), np.array([-100.0, 100.0])

    finger = loaded_finger(treadmill)
    term = EffectTerm(effect="load_friction", target="rh_FFJ3", values={"coefficient": coefficient})
    controls = np.zeros((400, len(finger.actuators)))
    controls[:, finger.actuators.index("rh_FFJ3")] = 50.0
    twin = finger.changed(Terms(effects=(term,)))
    angle = roll_out([twin.model], controls[None], twin.initial_qpos(np.zeros(len(twin.joints)))[None])[0]
    angle = angle[:, twin.qpos_adr[twin.joints.index("rh_FFJ3")]]
    speed = (angle[-1] - angle[200]) / (200 * twin.model.opt.timestep)
    assert speed == pytest.approx(torque * (1.0 - coefficient), rel=0.01 if coefficient <= 0.3 else 0.15)


@pytest.mark.parametrize("coefficient", [0.3, 0.42])
def test_a_brake_that_creeps_is_friction_whose_limit_is_set_by_the_load(coefficient: float):
    def soft(spec) -> None:  # a servo that lets friction hold it away from its target
        spec.option.gravity = np.array([0.0, 0.0, -2.0])
        joint, servo = spec.joint("rh_FFJ3"), spec.actuator("rh_A_FFJ3")
        joint.frictionloss, joint.damping, joint.armature = 0.01, np.array([0.05, 0.0, 0.0]), 2e-4
        servo.gainprm[0], servo.biasprm[1] = 1.0, -1.0

    finger = loaded_finger(soft)
    servo, joint = finger.actuators.index("rh_FFJ3"), finger.joints.index("rh_FFJ3")
    controls = np.zeros((1500, len(finger.actuators)))
    controls[:, servo] = np.repeat([0.0, 0.4, 0.9, 0.3, 0.7, 0.5], 250)  # holds of half a second
    column, dof = finger.qpos_adr[joint], finger.dof_adr[joint]

    model = finger.model
    limit = float(model.dof_frictionloss[dof])
    data = mujoco.MjData(model)
    data.qpos[:] = finger.initial_qpos(np.zeros(len(finger.joints)))
    exact = np.zeros(len(controls))
    for step, control in enumerate(controls):
        pull = model.actuator_gainprm[servo, 0] * (control[servo] - data.qpos[column])
        pull = np.clip(pull, *model.actuator_forcerange[servo])
        model.dof_frictionloss[dof] = limit + coefficient * abs(pull)
        data.ctrl[:] = control
        mujoco.mj_step(model, data)
        exact[step] = data.qpos[column]
    model.dof_frictionloss[dof] = limit

    def off(creep: float) -> float:
        values = {"coefficient": coefficient, "creep": creep}
        term = EffectTerm(effect="load_friction", target="rh_FFJ3", values=values)
        moved = move(finger.changed(Terms(effects=(term,))), controls)[1:, joint]
        return float(np.sqrt(np.mean((moved - exact) ** 2)))

    assert off(1.0) < 1.5e-3
    assert off(1.0) < off(0.0)


def test_stribeck_friction_without_its_fall_is_coulomb_friction(bench: Bench):
    falling = bench.move(bench.with_effects(("stribeck_friction", "rh_FFJ3", {"breakaway": 0.1, "velocity": 100.0})))
    coulomb = bench.move(bench.with_effects(("coulomb_friction", "rh_FFJ3", {"friction": 0.1})))
    assert np.std(falling - coulomb) < 0.4 * np.std(coulomb - bench.still)


def test_a_delay_of_whole_steps_is_a_shifted_command(bench: Bench):
    late = bench.controls.copy()
    column = bench.twin.actuators.index("rh_FFJ3")
    late[10:, column] = bench.controls[:-10, column]
    late[:10, column] = bench.controls[0, column]
    delayed = bench.with_effects(("command_delay", "rh_FFJ3", {"delay": 10 * bench.twin.model.opt.timestep}))
    np.testing.assert_allclose(bench.move(delayed), move(bench.twin, late), rtol=0, atol=1e-9)


def test_the_distal_joint_stays_behind_while_the_finger_closes():
    finger = loaded_finger(lambda spec: setattr(spec.option, "gravity", np.zeros(3)))
    controls = np.zeros((1500, len(finger.actuators)))
    controls[:, finger.actuators.index("rh_FFJ0")] = np.linspace(0.0, 2.8, 1500)
    distal, proximal = finger.joints.index("rh_FFJ1"), finger.joints.index("rh_FFJ2")
    alone = move(finger, controls)
    term = EffectTerm(effect="coupling", target="rh_FFJ0", values={})
    split = move(finger.changed(Terms(effects=(term,))), controls)
    assert np.abs(alone[:, distal] - alone[:, proximal]).max() < 0.1
    half = np.searchsorted(split[:, distal] + split[:, proximal], 1.2)
    assert split[half, distal] < 0.1
    assert split[half, proximal] > 1.0
    assert split[-1, distal] > 1.0
    values = LIBRARY["coupling"].complete({})
    upper = finger.model.joint(finger.hand.description.joints["rh_FFJ2"].joint).range[1]
    end = upper + values["stop"] + values["stop_slope"] * split[-1, distal]
    assert split[-1, proximal] == pytest.approx(end, abs=0.02)


@pytest.mark.parametrize("periods", [7.0, 20.0, 25.0, 61.0])
def test_a_ripples_waves_are_read_off_the_error_over_the_angle(smooth: TwinModel, periods: float):
    scale = smooth.scale("rh_FFJ3")
    angle = 0.7 + 0.6 * np.sin(np.linspace(0.0, 9.0, 2000))
    noise = np.random.default_rng(0).normal(0.0, 5e-4, angle.size)
    wave = 0.002 * np.sin(periods * angle + 1.0)
    # its waves stay in step over the whole travel: what is off by half a wave there is another law to a fit
    best = LIBRARY["torque_ripple"].suggested(scale, Seen(angle, np.zeros_like(angle), 0.004 + noise + wave))[0]
    assert best["amplitude"] == pytest.approx(0.002 * scale.kp, rel=0.15)
    found = best["amplitude"] / scale.kp * np.sin(best["periods"] * angle + best["phase"])
    assert found == pytest.approx(wave, abs=3e-4)


def test_a_stiff_stop_is_looked_for_where_the_joint_stands(smooth: TwinModel):
    scale = smooth.scale("rh_FFJ3")
    free = 0.6 + 0.55 * np.sin(np.linspace(0.0, 20.0, 4000))
    stop, stiffness = 1.1, 8.0
    angle = np.where(free > stop, stop + (free - stop) / (1.0 + stiffness), free)
    elsewhere = -0.03 * (angle - 0.2)  # what uncertain values have taken on in its stead
    found = LIBRARY["joint_stop"].suggested(scale, Seen(angle, np.zeros_like(angle), angle - free + elsewhere))
    near = [one for one in found if abs(scale.upper - one["upper"] - stop) < 0.1]
    assert any(0.3 < one["stiffness"] / (stiffness * scale.kp) < 3.0 for one in near)


def test_a_stop_that_only_the_widest_motion_meets_is_looked_for_there(smooth: TwinModel) -> None:
    """One sample in a hundred stands at it."""
    scale = smooth.scale("rh_FFJ3")
    command = 0.78 + 0.4 * np.sin(np.linspace(0.0, 60.0, 4000)) * np.linspace(0.5, 1.0, 4000)
    angle = np.minimum(command, np.quantile(command, 0.99))
    starts = LIBRARY["joint_stop"].suggested(scale, Seen(angle, np.zeros_like(angle), angle - command))
    ends = [scale.upper - one["upper"] for one in starts if one["lower"] == 0.0]
    assert min(abs(end - angle.max()) for end in ends) < 0.005


def test_two_stops_are_looked_for_at_once(smooth: TwinModel) -> None:
    """From one end alone a fit does not find the other: where that stop begins has no slope until it is entered."""
    scale = smooth.scale("rh_FFJ3")
    free = 0.75 + 0.55 * np.sin(np.linspace(0.0, 20.0, 4000))
    first, last, stiffness = 0.45, 1.0, 0.5
    inside = np.clip(free, first, last)
    angle = inside + (free - inside) / (1.0 + stiffness)
    best = LIBRARY["joint_stop"].suggested(scale, Seen(angle, np.zeros_like(angle), angle - free))[0]
    assert scale.lower + best["lower"] == pytest.approx(first, abs=0.05)
    assert scale.upper - best["upper"] == pytest.approx(last, abs=0.05)
    assert best["stiffness"] == pytest.approx(stiffness * scale.kp, rel=0.15)


def test_a_joint_that_hardly_travels_suggests_no_waves(smooth: TwinModel):
    angle = np.linspace(0.5, 0.6, 200)
    seen = Seen(angle, np.zeros_like(angle), np.sin(40.0 * angle))
    assert LIBRARY["torque_ripple"].suggested(smooth.scale("rh_FFJ3"), seen) == ()


def test_gravity_turns_and_keeps_its_size(bench: Bench):
    twin = bench.with_effects(("gravity_tilt", "hand", {"about_x": np.pi / 2, "about_y": 0.0}))
    x, y, z = bench.twin.model.opt.gravity
    np.testing.assert_allclose(twin.model.opt.gravity, [x, -z, y], atol=1e-12)


def test_less_friction_than_none_is_refused(bench: Bench):
    with pytest.raises(BadInput, match="frictionloss"):
        bench.with_effects(("coulomb_friction", "rh_FFJ3", {"friction": -1.0}))


def test_two_filters_at_one_actuator_are_refused(bench: Bench):
    with pytest.raises(BadInput, match="rate_limit"):
        bench.with_effects(("actuator_lag", "rh_FFJ3", {}), ("rate_limit", "rh_FFJ3", {}))


def test_inertia_is_divided_between_motor_and_joint_and_not_added(bench: Bench):
    still = _total_inertia(bench.twin.model)
    for target in ("rh_FFJ3", "rh_FFJ0"):
        twin = bench.with_effects(("backlash", target, {}))
        assert _total_inertia(twin.model, f"{bench.twin.place(target).actuator}_link") == pytest.approx(still, rel=1e-3)


def _total_inertia(model: mujoco.MjModel, link: str | None = None) -> float:
    """Kinetic energy (J) at a speed of 1 rad/s of every joint, with a motor as fast as what it drives."""
    data = mujoco.MjData(model)
    data.qvel[:] = [0.0 if model.joint(model.dof_jntid[i]).name.endswith("_motor") else 1.0 for i in range(model.nv)]
    if link is not None:
        mujoco.mj_forward(model, data)
        motor = model.joint(link.replace("_link", "_motor"))
        data.qvel[model.jnt_dofadr[motor.id]] = -data.ten_velocity[model.tendon(link).id]
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return float(0.5 * data.qvel @ full @ data.qvel)


@pytest.mark.parametrize(("given", "has"), [('kv="0"', False), ('kv="0.1"', True), ('dampratio="0.7"', True)])
def test_a_proportional_gain_that_was_set_is_a_weaker_servo_that_keeps_its_derivative_gain(
    given: str, has: bool, tmp_path: Path
):
    model = tmp_path / "one.xml"
    model.write_text(
        '<mujoco><worldbody><body><joint name="j" axis="0 1 0" range="-1 1"/><geom size="0.02"/></body></worldbody>'
        f'<actuator><position name="a" joint="j" kp="2" {given}/></actuator></mujoco>'
    )
    twin = TwinModel.load(load_hand(model=model))
    effect = LIBRARY["actuator_gain"]
    weak = EffectTerm(effect=effect.key, target="a", values=effect.as_factor(0.6))
    lower = twin.changed(twin.terms.with_parameters({"a.kp": 0.6 * twin.parameter("a.kp").read(twin.base_model)}))
    for field in ("actuator_gainprm", "actuator_biasprm"):
        changed = getattr(twin.changed(twin.terms.with_effect(weak)).model, field)
        np.testing.assert_allclose(changed, getattr(lower.model, field))
    tired = twin.changed(twin.terms.with_effect(EffectTerm(effect=effect.key, target="a", values={"factor": 0.6})))
    np.testing.assert_allclose(tired.model.actuator_biasprm, 0.6 * twin.model.actuator_biasprm)
    low, high = effect.bounds(twin.scale("a"))["derivative"]
    assert (low < high) == has


@pytest.mark.parametrize("inertial", ["", '<inertial pos="0.15 0 0" mass="0.2" diaginertia="1e-4 2e-3 2e-3"/>'])
def test_a_load_hangs_at_the_end_of_the_last_link_whoever_states_its_mass(tmp_path: Path, inertial: str):
    """A servo of 40 N m/rad gives way by 0.1 kg at 0.3 m, whether the link's mass is stated or that of its shapes."""
    path = tmp_path / "arm.xml"
    path.write_text(
        f"""<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/><worldbody>
        <body name="link"><joint name="joint" axis="0 1 0" range="-2 2" damping="2" armature="0.1"/>{inertial}
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.2"/></body></worldbody>
        <actuator><position name="joint" joint="joint" kp="40" kv="1" ctrlrange="-2 2"/></actuator></mujoco>"""
    )
    twin = TwinModel.load(load_hand(model=path))
    loaded = twin.changed(
        Terms(effects=(EffectTerm(effect="payload", target="joint", values={"mass": 0.1, "at": 1.0}),))
    )
    rests = [float(move(one, np.zeros((1500, 1)))[-1, 0]) for one in (twin, loaded)]
    assert rests[1] - rests[0] == pytest.approx(0.1 * 9.81 * 0.3 / 40, rel=0.01)


@pytest.mark.parametrize("across", ["across_1", "across_2"])
def test_a_load_beside_its_line_is_that_far_from_it(tmp_path: Path, across: str):
    """Of a roll axis that lies level it turns what a load on the line leaves as it is."""
    path = tmp_path / "roll.xml"
    path.write_text(
        """<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/><worldbody>
        <body name="link"><joint name="joint" axis="1 0 0" range="-2 2" damping="2" armature="0.1"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.2"/></body></worldbody>
        <actuator><position name="joint" joint="joint" kp="40" kv="1" ctrlrange="-2 2"/></actuator></mujoco>"""
    )
    twin = TwinModel.load(load_hand(model=path))
    values = {"mass": 0.1, "at": 1.0, across: 0.05}
    loaded = twin.changed(Terms(effects=(EffectTerm(effect="payload", target="joint", values=values),)))
    end, at = (loaded.model.body(name).ipos + loaded.model.body(name).pos for name in ("link", "joint_payload"))
    assert np.linalg.norm(at - 2.0 * end) == pytest.approx(0.05, rel=1e-6)
    rest = float(move(loaded, np.zeros((1500, 1)))[-1, 0])
    level = abs(float(at[1]))  # of the angle it comes to its arm is shorter by nothing that counts
    assert abs(rest) == pytest.approx(0.1 * 9.81 * level / 40, rel=0.02, abs=2e-6)


def test_a_load_is_one_and_the_same_at_all_joints_that_carry_it_alike(tmp_path: Path):
    """A link that turns about two joints, and a knuckle that is one point, carry what the next link does."""
    path = tmp_path / "arm.xml"
    link = '<geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.2"/>'
    path.write_text(
        f"""<mujoco><compiler angle="radian"/><worldbody><body>
        <joint name="yaw" axis="0 0 1"/><joint name="pitch" axis="0 1 0"/>{link}
        <body pos="0.3 0 0"><inertial pos="0 0 0" mass="0.01" diaginertia="1e-5 1e-5 1e-5"/>
        <joint name="the_knuckle" axis="0 0 1"/><body><joint name="tip" axis="0 1 0"/>{link}</body></body>
        </body></worldbody></mujoco>"""
    )
    twin = TwinModel.load(load_hand(model=path))
    places = [twin.place(joint) for joint in twin.joints]
    assert len(places) == 4
    assert {place.target for place in LIBRARY["payload"].distinct(places)} == {"pitch", "tip"}
    assert [place.target for place in LIBRARY["armature"].distinct(places)] == list(twin.joints)
    loaded = twin.changed(Terms(effects=(EffectTerm(effect="payload", target="the_knuckle", values={"mass": 0.1}),)))
    asked = {one.name for one in hypotheses(loaded, twin.joints, whole_hand=False)}
    assert "payload:pitch" in asked
    assert not {"payload:tip", "payload:the_knuckle"} & asked
