"""Hand descriptions: what comes along, what a bare MJCF gives, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import yaml

from twin_daemon import resources
from twin_daemon.errors import BadInput
from twin_daemon.hand import known_hands, load_hand

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
THIRD_PARTY = SHARED / "third_party_hands" / "shadow_hand"
SO101 = SHARED / "so101_real" / "so101.xml"

ONE_JOINT = """<mujoco><compiler angle="radian"/><worldbody><body><joint name="rh_FFJ3" range="-1 1" {joint}/>
<geom size="0.05" {geom}/></body></worldbody>
<actuator><position name="{actuator}" joint="rh_FFJ3" kp="1"/></actuator></mujoco>"""


def one_joint(folder: Path, joint: str = "", geom: str = "", actuator: str = "FFJ3") -> Path:
    path = folder / "one.xml"
    path.write_text(ONE_JOINT.format(joint=joint, geom=geom, actuator=actuator))
    return path


def edited(folder: Path, **changes: object) -> Path:
    """A copy of the Shadow Hand's description with top-level keys replaced."""
    content = yaml.safe_load((resources.models_dir() / "shadow_hand" / "hand.yaml").read_text())
    content["model"] = str(resources.models_dir() / "shadow_hand" / "shadow_hand.xml")
    content |= changes
    path = folder / "hand.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


def refusal(**arguments: object) -> str:
    with pytest.raises(BadInput) as caught:
        load_hand(**arguments)  # type: ignore[arg-type]
    line = str(caught.value)
    assert "\n" not in line
    return line


def test_the_default_is_the_shadow_hand() -> None:
    hand = load_hand()
    assert hand == load_hand("shadow_hand") == load_hand(resources.models_dir() / "shadow_hand")
    assert (hand.name, len(hand.joints), len(hand.commands)) == ("shadow_hand", 24, 20)
    assert list(hand.joints) == sorted(hand.joints) == hand.description.trajectory_order
    assert "shadow_hand" in known_hands()


def test_j0_drives_the_sum_of_two_joints() -> None:
    hand = load_hand()
    assert set(hand.description.commands["rh_FFJ0"].joints) == {"rh_FFJ1", "rh_FFJ2"}
    assert hand.command_range_rad["rh_FFJ0"] == pytest.approx((0.0, math.pi), abs=1e-4)
    assert hand.velocity_limit_rad_s("rh_FFJ0") == 2 * hand.velocity_limit_rad_s("rh_FFJ3")
    assert "rh_FFJ1" not in hand.commands
    assert hand.joint_range_rad["rh_FFJ3"] == pytest.approx((-0.261799, 1.5708))


def test_groups_cover_the_hand() -> None:
    groups = load_hand().description.groups
    assert groups["FJ1"] == ["rh_FFJ1", "rh_LFJ1", "rh_MFJ1", "rh_RFJ1"]
    assert set(groups["LF"]) == {f"rh_LFJ{number}" for number in range(1, 6)}
    assert set(groups["fingers"]) | set(groups["thumb"]) == set(groups["hand"])
    assert set(groups["hand"]) | set(groups["wrist"]) == set(groups["all"])


def test_topics_and_keys_are_those_that_the_outside_relies_on() -> None:
    description = load_hand().description
    assert description.position_topic("rh_FFJ0") == "/sh_rh_ffj0_position_controller/command"
    assert description.topics.trajectory == "/rh_trajectory_controller/command"
    assert description.key("joint_states") == "shadow_hand/joint_states"
    assert description.key("twin_joint_states") == "twin/shadow_hand/joint_states"
    assert description.key("command", verb="move") == "twin/shadow_hand/command/move"
    assert description.rate_hz == 125


@pytest.mark.parametrize(("file", "prefix"), [("right_hand.xml", "rh_"), ("left_hand.xml", "lh_")])
def test_a_foreign_shadow_hand_needs_no_description(file: str, prefix: str) -> None:
    if not (THIRD_PARTY / file).is_file():
        pytest.skip(f"{THIRD_PARTY / file} is not here")
    hand = load_hand(model=THIRD_PARTY / file)
    own = load_hand()
    assert [name.removeprefix(prefix) for name in hand.joints] == [name.removeprefix("rh_") for name in own.joints]
    assert {name.removeprefix(prefix) for name in hand.commands} == {name.removeprefix("rh_") for name in own.commands}
    assert hand.description.commands[f"{prefix}FFJ0"].actuator == f"{prefix}A_FFJ0"
    assert set(hand.description.groups) >= {"FJ1", "FF", "thumb", "wrist", "all"}


def test_a_description_can_be_used_with_another_model() -> None:
    if not (THIRD_PARTY / "right_hand.xml").is_file():
        pytest.skip(f"{THIRD_PARTY} is not here")
    hand = load_hand("shadow_hand", THIRD_PARTY / "right_hand.xml")
    assert (hand.name, hand.model_path.name) == ("shadow_hand", "right_hand.xml")
    assert "lh_FFJ1" in refusal(hand="shadow_hand", model=THIRD_PARTY / "left_hand.xml")


def test_an_arm_is_a_hand_without_fingers() -> None:
    if not SO101.is_file():
        pytest.skip(f"{SO101} is not here")
    hand = load_hand(model=SO101)
    assert len(hand.joints) == 6
    assert set(hand.joints) == set(hand.commands)
    assert list(hand.description.groups) == ["all"]


@pytest.mark.parametrize("actuator", ["rh_A_FFJ3", "rh_FFJ3", "FFJ3", "A_FFJ3"])
def test_an_actuator_is_known_in_all_its_spellings(tmp_path: Path, actuator: str) -> None:
    hand = load_hand(model=one_joint(tmp_path, actuator=actuator))
    assert hand.description.commands["rh_FFJ3"].actuator == actuator
    assert hand.command_range_rad["rh_FFJ3"] == (-1.0, 1.0)  # the joint's, since the actuator has none


def test_free_and_unnamed_joints_and_motors_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "some robot.xml"
    path.write_text(
        """<mujoco><worldbody><body><freejoint name="floating"/><geom size="0.1"/>
        <body><joint name="a"/><geom size="0.1"/><body><joint/><geom size="0.1"/></body></body></body></worldbody>
        <actuator><motor name="torque" joint="a"/><position name="a" joint="a" kp="1"/></actuator></mujoco>"""
    )
    hand = load_hand(model=path)
    assert (hand.name, hand.joints, hand.commands) == ("some_robot", ("a",), ("a",))
    assert hand.joint_range_rad["a"] == (-math.inf, math.inf)


@pytest.mark.parametrize(
    "wrong", ['damping="-0.1"', 'frictionloss="-0.1"', 'armature="-1"', 'stiffness="-2"', 'damping="inf"']
)
def test_an_unphysical_joint_is_refused_by_name(tmp_path: Path, wrong: str) -> None:
    line = refusal(model=one_joint(tmp_path, joint=wrong))
    for part in ("rh_FFJ3", wrong.split("=")[0], "one.xml"):
        assert part in line


def test_a_model_that_cannot_be_used_says_why(tmp_path: Path) -> None:
    assert "no such model" in refusal(model=tmp_path / "none.xml")
    assert "mass" in refusal(model=one_joint(tmp_path, geom='mass="0"'))
    (tmp_path / "broken.xml").write_text("<mujoco><worldbody>")
    assert "cannot compile" in refusal(model=tmp_path / "broken.xml")
    (tmp_path / "empty.xml").write_text("<mujoco/>")
    assert "no named hinge" in refusal(model=tmp_path / "empty.xml")


def test_unknown_hands_are_answered_with_the_nearest() -> None:
    assert "Did you mean 'shadow_hand'?" in refusal(hand="shadow_hnd")
    assert "no such hand description" in refusal(hand="elsewhere/hand.yaml")
    assert "--model" in refusal(hand=resources.models_dir() / "shadow_hand" / "shadow_hand.xml")


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"rate": 100}, ["rate:", "Did you mean 'rate_hz'?"]),
        ({"rate_hz": -1}, ["rate_hz:", "greater than 0"]),
        ({"namespace": "a/../b c"}, ["namespace:"]),
        ({"schema": 2}, ["schema:"]),
        ({"model": "other.xml"}, ["no such model file", "other.xml"]),
        ({"joints": {}}, ["joints:"]),
        ({"joints": {"rh_FFJ3": {"noise": 1.0}}}, ["joints.rh_FFJ3.noise:", "Did you mean 'noise_rad'?"]),
        ({"joints": {"rh_FFJ3": {"noise_rad": -1}}, "commands": {}, "groups": {}}, ["joints.rh_FFJ3.noise_rad:"]),
        ({"joints": {"rh_FFJ9": {}}, "commands": {}, "groups": {}}, ["joints.rh_FFJ9", "shadow_hand.xml"]),
        ({"groups": {"mine": ["rh_FFJ33"]}}, ["groups.mine", "Did you mean 'rh_FFJ3'?"]),
        ({"trajectory_order": ["rh_FFJ3", "rh_FFJ3"]}, ["trajectory_order", "twice"]),
        ({"commands": {"rh_FFJ3": {"actuator": "rh_A_FFJ7", "joints": ["rh_FFJ3"]}}}, ["rh_A_FFJ7", "Did you mean"]),
        ({"commands": {"rh_FFJ0": {"actuator": "rh_A_FFJ0", "joints": ["rh_FFJ2"]}}}, ["commands.rh_FFJ0", "moves"]),
        ({"topics": {"position_controller": "/{finger}"}}, ["topics.position_controller", "placeholders"]),
        ({"keys": {"state": "{hand}/state"}}, ["keys", "placeholders"]),
    ],
)
def test_a_wrong_description_is_one_line_with_file_and_key(
    tmp_path: Path, changes: dict[str, object], expected: list[str]
) -> None:
    line = refusal(hand=edited(tmp_path, **changes))
    assert str(tmp_path) in line
    for part in expected:
        assert part in line


def test_files_that_are_no_descriptions_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "hand.yaml"
    for content, expected in (
        ("- a\n- b\n", "a mapping"),
        ("name: [\n", "no valid YAML"),
        ("name: a\nname: b\n", "stands there twice"),
        ("{}", "required"),
        ("? [1, 2]\n: 3\n", "hand.yaml"),
    ):
        path.write_text(content)
        assert expected in refusal(hand=tmp_path)
    path.write_bytes(b"\xff\xfe\x00name")
    assert "no valid YAML" in refusal(hand=path)
    aliases = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
        f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 9)
    )
    path.write_text(aliases + "name: *a8\n")
    assert len(refusal(hand=path)) < 1000


def test_state_folder_follows_the_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("TWIN_STATE_DIR", raising=False)
    monkeypatch.setenv("STATE_DIRECTORY", f"{tmp_path / 'systemd'}:/elsewhere")
    assert resources.state_dir() == tmp_path / "systemd"
    monkeypatch.setenv("TWIN_STATE_DIR", str(tmp_path / "own"))
    assert resources.state_dir() == tmp_path / "own"
    monkeypatch.delenv("TWIN_STATE_DIR")
    monkeypatch.delenv("STATE_DIRECTORY")
    assert "twin_daemon" in resources.state_dir().parts
