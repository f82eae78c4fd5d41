"""Laws that hold for every effect of the library; a new effect is tested by standing in their folder."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path

import mujoco
import numpy as np
import pytest
import yaml

from tests.effects.conftest import Bench, loaded_finger, rich_controls
from twin_daemon import effects
from twin_daemon.effects import BUILT_IN, LIBRARY
from twin_daemon.effects.mjcf_text import mjcf_text
from twin_daemon.errors import BadInput
from twin_daemon.hand import load_hand
from twin_daemon.plant import HIDDEN
from twin_daemon.simulation.rollout import roll_out
from twin_daemon.simulation.terms import EffectTerm, Terms, load_terms
from twin_daemon.simulation.twin import TwinModel

CONTRACT = {
    "viscous_friction", "coulomb_friction", "stribeck_friction", "load_friction", "backlash", "hysteresis",
    "tendon_elasticity", "coupling", "spring", "nonlinear_spring", "joint_stop", "armature", "payload",
    "gravity_tilt", "actuator_gain", "actuator_saturation", "actuator_lag", "rate_limit", "command_delay",
    "torque_ripple", "sensor_offset", "sensor_gain", "dead_zone",
}  # fmt: skip
VISIBLE_RAD = 1e-3
SIZES = ("nq", "nv", "nu", "na", "nactuator", "nhistory", "nbody", "njnt", "ntendon", "neq", "npair", "nplastic")
ON_MECHANICS = [key for key, effect in LIBRARY.items() if effect.acts_on != "sensor"]
DISSIPATIVE = [key for key, effect in LIBRARY.items() if effect.dissipative]

every_effect = pytest.mark.parametrize("key", LIBRARY)


def test_the_library_has_every_key_of_the_contract():
    assert set(LIBRARY) >= CONTRACT


def test_the_library_is_what_stands_in_its_folder_by_rank():
    files = {path.stem for path in Path(effects.__file__).parent.glob("*.py")}
    assert set(BUILT_IN) <= files
    ranks = [effect.rank for effect in BUILT_IN.values()]
    assert ranks == sorted(set(ranks))


def test_every_effect_that_comes_with_the_program_has_a_plant_that_shares_no_code_with_it():
    assert set(BUILT_IN) <= set(HIDDEN)


@pytest.mark.parametrize("times", [1e3, 1e9])
@every_effect
def test_a_stronger_or_wider_robot_is_searched_further_and_never_beyond_physics(key: str, times: float, bench: Bench):
    weak = bench.twin.scale("rh_FFJ3")
    far = {name: times * getattr(weak, name) for name in ("kp", "inertia", "length", "lower", "upper")}
    strong = replace(weak, **far)
    for parameter in LIBRARY[key].parameters:
        (lower, upper), (far_lower, far_upper) = parameter.bounds(weak), parameter.bounds(strong)
        assert far_lower <= lower < upper <= far_upper
        assert parameter.limits[0] <= far_lower < far_upper <= parameter.limits[1]
        assert (upper < far_upper) == (parameter.reach is not None)


@every_effect
def test_an_effect_explains_itself(key: str):
    effect = LIBRARY[key]
    assert effect.key == key
    assert effect.title
    for text in (effect.story.what, effect.story.shows, effect.story.cause, effect.story.remedy):
        assert text.endswith(".")
    assert effect.story.excitation
    assert set(effect.confusable) <= set(LIBRARY) - {key}
    assert set(effect.contains) <= set(LIBRARY) - {key}
    for parameter in effect.parameters:
        assert parameter.unit
        assert parameter.meaning
        assert parameter.lower <= parameter.neutral <= parameter.upper
        assert parameter.lower <= parameter.default <= parameter.upper
        assert not parameter.log or parameter.lower > 0


@every_effect
def test_neutral_values_change_nothing(key: str, bench: Bench):
    places = bench.places(key)
    assert places
    for target in places:
        moved = bench.move(bench.with_effects((key, target, LIBRARY[key].neutral())))
        np.testing.assert_allclose(moved, bench.still, rtol=0, atol=LIBRARY[key].neutral_within_rad)


@every_effect
def test_default_values_are_visible(key: str, bench: Bench):
    for target in bench.places(key):
        moved = bench.move(bench.with_effects((key, target, {})))
        assert np.abs(moved - bench.still).max() > VISIBLE_RAD


@every_effect
def test_starts_are_a_handful_of_sound_and_different_motions(key: str, bench: Bench):
    effect = LIBRARY[key]
    for target in bench.places(key):
        starts = effect.starts(bench.twin.scale(target))
        assert 2 <= len(starts) <= 6
        moves = [bench.move(bench.with_effects((key, target, values))) for values in starts]
        assert all(np.isfinite(moved).all() for moved in moves)
        assert len({moved.tobytes() for moved in moves}) > 1
        assert max(np.abs(moved - bench.still).max() for moved in moves) > VISIBLE_RAD


@every_effect
def test_a_small_step_in_a_parameter_is_a_small_step_in_the_motion(key: str, bench: Bench):
    target = bench.places(key)[0]
    values = LIBRARY[key].complete({})
    moved = bench.move(bench.with_effects((key, target, values)))
    for parameter in LIBRARY[key].parameters:
        inwards = -1 if values[parameter.name] == parameter.upper else 1
        near = values | {parameter.name: values[parameter.name] * (1 + inwards * 1e-6) + inwards * 1e-9}
        stepped = bench.move(bench.with_effects((key, target, near)))
        assert np.abs(stepped - moved).max() < 2e-3


@every_effect
def test_the_structure_does_not_depend_on_the_values(key: str, bench: Bench):
    """But on those that say which of several laws it is."""
    effect = LIBRARY[key]
    fixed = {p.name: (p.lower, p.upper) for p in effect.parameters if p.fixed}
    laws = [dict(zip(fixed, values, strict=True)) for values in product(*fixed.values())]
    for target, law in product(bench.places(key), laws):
        extremes = ({p.name: p.upper for p in effect.parameters}, effect.neutral(), effect.complete({}))
        sizes = set()
        for values in extremes:
            model = bench.with_effects((key, target, {**values, **law})).model
            sizes.add(tuple(getattr(model, name) for name in SIZES if hasattr(model, name)))
        assert len(sizes) == 1


@pytest.mark.parametrize("key", ON_MECHANICS)
def test_the_plain_mjcf_moves_identically(key: str, bench: Bench):
    for target in bench.places(key):
        twin = bench.with_effects((key, target, LIBRARY[key].starts(bench.twin.scale(target))[0]))
        text = mjcf_text(twin.spec)
        read = mujoco.MjModel.from_xml_string(text)
        start = twin.initial_qpos(np.linalg.lstsq(twin.drive, bench.controls[0], rcond=None)[0])
        positions = roll_out([read], bench.controls[None], start[None])
        own = roll_out([twin.model], bench.controls[None], start[None])
        np.testing.assert_allclose(positions, own, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("one", "other"), list(pairwise(ON_MECHANICS)))
def test_the_order_of_adding_does_not_matter(one: str, other: str, bench: Bench):
    if other in LIBRARY[one].excludes:
        pytest.skip("these two exclude each other")
    here = [(key, target, {}) for key in (one, other) for target in bench.places(key)[:2]]
    forward, backward = bench.with_effects(*here), bench.with_effects(*reversed(here))
    assert np.array_equal(bench.move(forward), bench.move(backward))


@pytest.mark.parametrize("key", DISSIPATIVE)
def test_friction_never_adds_energy(key: str, bench: Bench):
    def let_go(spec) -> None:
        spec.option.gravity = np.zeros(3)
        for actuator in spec.actuators:
            actuator.gainprm, actuator.biasprm = np.zeros(10), np.zeros(10)
        for joint in spec.joints:
            joint.damping, joint.frictionloss = np.array([0.002, 0.0, 0.0]), 0.0

    free = loaded_finger(let_go)
    for target in ("rh_FFJ3", "rh_FFJ0", "rh_FFJ1"):
        if target not in (*free.joints, *free.actuators) or not LIBRARY[key].applies(free.place(target)):
            continue
        for values in LIBRARY[key].starts(bench.twin.scale(target)):
            if any(value < 0 for value in values.values()):
                continue  # less friction than this model has would be refused
            model = free.changed(Terms(effects=(EffectTerm(effect=key, target=target, values=values),))).model
            energy = _kinetic_energy(model, free)
            assert energy.max() <= energy[0] * (1 + 1e-6)
            assert energy[-1] < 0.9 * energy[0]


def _kinetic_energy(model: mujoco.MjModel, free: TwinModel) -> np.ndarray:
    """(T,) J of a free motion that begins with a push."""
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(model)
    data.qpos[free.qpos_adr] = [0.8, 0.8, 0.6, 0.0]
    driven = free.drive @ data.qpos[free.qpos_adr]
    for index, name in enumerate(free.actuators):
        motor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"{free.place(name).actuator}_motor")
        if motor >= 0:
            data.qpos[model.jnt_qposadr[motor]] = driven[index]
    data.qvel[free.dof_adr] = [1.5, -1.0, 2.0, 0.0]
    energy = []
    for _ in range(200):
        mujoco.mj_step(model, data)
        energy.append(float(data.energy[1]))
    return np.array(energy)


@every_effect
def test_an_effect_survives_being_stored(key: str, bench: Bench, tmp_path):
    target = bench.places(key)[0]
    terms = Terms(effects=(EffectTerm(effect=key, target=target, values=LIBRARY[key].complete({})),))
    path = tmp_path / "terms.yaml"
    path.write_text(yaml.safe_dump(terms.as_json()))
    assert np.array_equal(bench.move(bench.twin.changed(load_terms(path))), bench.move(bench.twin.changed(terms)))


@every_effect
def test_values_outside_physics_are_refused(key: str):
    effect = LIBRARY[key]
    for parameter in effect.parameters:
        lower, upper = parameter.limits
        for beyond in (lower - 1.0, upper * 1.01 + 1.0, float("nan")):
            with pytest.raises(BadInput, match=parameter.name):
                effect.complete({parameter.name: beyond})
    with pytest.raises(BadInput, match="no parameter"):
        effect.complete({"colour": 1.0})


@every_effect
def test_an_effect_works_on_another_robot(key: str, shared_data):
    hand = load_hand(model=shared_data / "so101_real" / "so101.xml")
    arm = TwinModel.load(hand)
    controls = rich_controls(arm)[:400]
    for target in ("elbow_flex", "hand"):
        if not LIBRARY[key].applies(arm.place(target)):
            continue
        for values in LIBRARY[key].starts(arm.scale(target)):
            twin = arm.changed(Terms(effects=(EffectTerm(effect=key, target=target, values=values),)))
            positions = roll_out([twin.model], controls[None], twin.initial_qpos(np.zeros(len(arm.joints)))[None])
            assert np.isfinite(positions).all()
            assert np.abs(positions[:, :, twin.qpos_adr]).max() < 10.0


@pytest.mark.parametrize(("key", "law"), [(key, law) for key, effect in LIBRARY.items() for law in effect.limit_of])
def test_the_limit_of_a_law_is_reached_from_every_value_of_that_law(key: str, law: str, bench: Bench):
    for start in LIBRARY[law].starts(bench.twin.scale("rh_FFJ3")):
        values = LIBRARY[key].as_limit_of(LIBRARY[law].complete(start))
        complete = LIBRARY[key].complete(values)
        assert set(values) <= set(complete)
        assert complete != LIBRARY[key].complete(LIBRARY[key].neutral())


@pytest.mark.parametrize(("key", "law"), [(key, law) for key, effect in LIBRARY.items() for law in effect.limit_of])
def test_a_law_at_its_bound_moves_as_its_limit_does(key: str, law: str, bench: Bench):
    for start in LIBRARY[key].starts(bench.twin.scale("rh_FFJ3")):
        limit = bench.move(bench.with_effects((key, "rh_FFJ3", start)))
        at_bound = bench.move(bench.with_effects((law, "rh_FFJ3", LIBRARY[key].as_law_at_limit(start))))
        shown = np.sqrt(((limit - bench.still) ** 2).mean())
        assert np.sqrt(((at_bound - limit) ** 2).mean()) < 0.1 * shown
