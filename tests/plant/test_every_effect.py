"""What holds for every hidden effect: it shows, its neutral value does not, and it does not hang on the time step."""

from __future__ import annotations

import numpy as np
import pytest

from twin_daemon.hand import Hand
from twin_daemon.plant import FOREIGN, HIDDEN, Plant, parse_hidden
from twin_daemon.plant.mechanisms import MECHANISMS
from twin_daemon.plant.motions import rich
from twin_daemon.plant.recording import Run, simulate

CONTRACT = {
    *("viscous_friction", "coulomb_friction", "stribeck_friction", "load_friction", "backlash", "hysteresis"),
    *("tendon_elasticity", "coupling", "spring", "nonlinear_spring", "joint_stop", "armature", "payload"),
    *("gravity_tilt", "actuator_gain", "actuator_saturation", "actuator_lag", "rate_limit", "command_delay"),
    *("torque_ripple", "sensor_offset", "sensor_gain", "dead_zone"),
}
FINGERS = ("FF", "MF", "RF", "LF")
WHOLE = "gravity_tilt"


def place(key: str, finger: str) -> str:
    acts_on = HIDDEN[key].acts_on
    if acts_on == "hand":
        return key
    return f"{key}:{finger}J0" if acts_on == "finger" else f"{key}:{finger}J3"


def groups() -> list[dict[str, str]]:
    """Four effects at a time, one a finger, so that a run serves four: {finger: key}."""
    keys = [key for key in HIDDEN if key != WHOLE]
    starts = range(0, len(keys), len(FINGERS))
    return [dict(zip(FINGERS, keys[first : first + len(FINGERS)], strict=False)) for first in starts]


def moved(hand: Hand, *texts: str, step_s: float = 0.0005, strength: str = "") -> Run:
    hidden = [parse_hidden(text + strength, hand) for text in texts]
    plant = Plant(hand, hidden=hidden, step_s=step_s, ideal_sensors=True)
    motion = rich(hand, [f"{finger}J{i}" for finger in FINGERS for i in (3, 0)], seconds=3.5, seed=3)
    return simulate(plant, motion)


@pytest.fixture(scope="module")
def nominal(hand: Hand) -> Run:
    return moved(hand)


def test_the_plant_knows_every_effect_of_the_contract_and_some_that_no_library_has() -> None:
    assert set(HIDDEN) - set(FOREIGN) == CONTRACT
    assert set(MECHANISMS) == set(HIDDEN)
    assert len(FOREIGN) >= 8


def of_finger(run: Run, finger: str) -> np.ndarray:
    return run.position[:, [i for i, name in enumerate(run.joints) if name.startswith(f"rh_{finger}J")]]


@pytest.mark.parametrize("group", groups(), ids=lambda group: "+".join(group.values()))
def test_effects_show_and_converge_with_the_step(hand: Hand, nominal: Run, group: dict[str, str]) -> None:
    texts = [place(key, finger) for finger, key in group.items()]
    mild, fine = moved(hand, *texts), moved(hand, *texts, step_s=0.00025)
    for finger, key in group.items():
        difference = of_finger(mild, finger) - of_finger(nominal, finger)
        visible = np.sqrt((difference**2).mean(axis=0)).max()
        refined = of_finger(fine, finger) - of_finger(mild, finger)
        assert visible > 0.001, key
        assert np.sqrt((refined**2).mean(axis=0)).max() < min(0.002, 0.5 * visible), key


def test_gravity_tilt_shows(hand: Hand, nominal: Run) -> None:
    difference = moved(hand, WHOLE).position - nominal.position
    assert np.sqrt((difference**2).mean(axis=0)).max() > 0.001


@pytest.mark.parametrize("finger", FINGERS[:2])
def test_neutral_values_change_nothing(hand: Hand, nominal: Run, finger: str) -> None:
    """All effects at once; a gap and a soft strand exclude each other, so each finger leaves out one of them."""
    left_out = "backlash" if finger == "FF" else "tendon_elasticity"
    texts = [f"{place(key, finger)}={kind.neutral}" for key, kind in HIDDEN.items() if key != left_out]
    assert np.abs(moved(hand, *texts).position - nominal.position).max() < 1e-9


@pytest.mark.slow
def test_severe_effects_stay_stable_and_show_more(hand: Hand, nominal: Run) -> None:
    for group in groups():
        texts = [place(key, finger) + "=severe" for finger, key in group.items()]
        run = moved(hand, *texts)
        assert np.isfinite(run.position).all()
        for finger, key in group.items():
            difference = of_finger(run, finger) - of_finger(nominal, finger)
            assert np.sqrt((difference**2).mean(axis=0)).max() > 0.003, key
