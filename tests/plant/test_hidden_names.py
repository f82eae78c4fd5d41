"""How people write hidden effects, and what they read when it is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin_daemon.errors import BadInput
from twin_daemon.hand import Hand, load_hand
from twin_daemon.plant import HIDDEN, Hidden, Plant, parse_hidden


def test_joint_and_value_are_optional(hand: Hand) -> None:
    assert parse_hidden("backlash:rh_FFJ3=0.05") == Hidden("backlash", "rh_FFJ3", 0.05)
    assert parse_hidden("coulomb_friction:FFJ3") == Hidden("coulomb_friction", "FFJ3")
    assert parse_hidden("gravity_tilt=0.3") == Hidden("gravity_tilt", None, 0.3)
    assert parse_hidden("spring:FFJ2=severe,ref=0.4") == Hidden("spring", "FFJ2", "severe", {"ref": 0.4})
    assert parse_hidden("coulomb_friction:FFJ3", hand).joint == "rh_FFJ3"
    assert parse_hidden("coulomb_friction", hand).joint == "rh_FFJ3"
    assert parse_hidden("coupling", hand).joint == "rh_FFJ0"
    assert parse_hidden("coupling:MFJ1", hand).joint == "rh_MFJ0"
    assert parse_hidden("coulomb_friction:MFJ0", hand).joint == "rh_MFJ0"
    assert parse_hidden("gravity_tilt", hand).joint is None


def test_the_answer_names_place_and_numbers(hand: Hand) -> None:
    plant = Plant(hand, hidden=[Hidden("stribeck_friction", "RFJ3", "severe")])
    (answer,) = plant.hidden
    assert answer.joint == "rh_RFJ3"
    assert answer.value == pytest.approx(HIDDEN["stribeck_friction"].severe * 10.0)
    assert answer.more == {"velocity": pytest.approx(0.1)}
    assert parse_hidden(str(answer), hand) == answer


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("backlahs:rh_FFJ3=0.05", "Did you mean 'backlash'"),
        ("backlash:rh_FFJ9=0.05", "Did you mean 'rh_FFJ"),
        ("backlash:rh_FFJ1", "use 'rh_FFJ0'"),
        ("sensor_offset:FFJ0=0.1", "cannot act on 'FFJ0'"),
        ("gravity_tilt:FFJ3=0.1", "whole hand"),
        ("backlash:FFJ3=wide", "'wide' is no number"),
        ("backlash:FFJ3=nan", "is no number"),
        ("backlash:FFJ3=-0.1", "Allowed: 0 to 1 rad"),
        ("coulomb_friction:FFJ3=inf", "is no value"),
        ("backlash:FFJ3=0.1,0.2", "second value"),
        ("spring:FFJ3=0.1,reff=0.2", "Did you mean 'ref'"),
        ("", "no hidden effect ''"),
    ],
)
def test_a_wrong_name_or_value_says_what_is_allowed(hand: Hand, text: str, says: str) -> None:
    with pytest.raises(BadInput) as caught:
        parse_hidden(text, hand)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_contradictions_are_refused(hand: Hand) -> None:
    for texts in (("spring", "spring:FFJ3=1"), ("backlash", "tendon_elasticity")):
        with pytest.raises(BadInput):
            Plant(hand, hidden=[parse_hidden(text, hand) for text in texts])


@given(st.text(max_size=40))
def test_text_that_names_no_effect_is_refused_in_one_line(text: str) -> None:
    if text.partition("=")[0].partition(":")[0].strip() in HIDDEN:
        return
    with pytest.raises(BadInput) as caught:
        parse_hidden(text)
    assert "\n" not in str(caught.value)


def test_a_model_without_pairs_has_no_coupling(tmp_path: Path) -> None:
    model = tmp_path / "arm.xml"
    model.write_text(
        """<mujoco><worldbody><body><joint name="a" range="-1 1" limited="true" damping="0.1"/>
        <geom size="0.1"/></body></worldbody><actuator><position name="a" joint="a" kp="5"/></actuator></mujoco>"""
    )
    arm = load_hand(model=model)
    with pytest.raises(BadInput, match="nothing that coupling"):
        parse_hidden("coupling", arm)
    assert parse_hidden("backlash", arm).joint == "a"
