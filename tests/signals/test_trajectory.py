"""Trajectories: what the files mean, what is refused, and that the ones that come along are safe."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from twin_daemon.errors import BadInput
from twin_daemon.hand import load_hand
from twin_daemon.signals.trajectory import (
    Trajectory,
    allowed_range,
    known_trajectories,
    load_trajectory,
    save_trajectory,
)

REAL = Path(__file__).resolve().parents[3] / "shared" / "data" / "shadow_hand_real" / "trajectories.yaml"
HAND = load_hand()
COMMAND_PERIOD_S = 1 / 125


def written(folder: Path, text: str) -> Path:
    path = folder / "motions.yaml"
    path.write_text("hand_trajectories:\n" + text)
    return path


def refusal(ref: str | Path) -> str:
    with pytest.raises(BadInput) as caught:
        load_trajectory(ref, HAND)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_the_names_that_users_rely_on_come_along() -> None:
    assert set(known_trajectories()) >= {
        "hand_closing",
        "index_closing",
        "thumb_calibration",
        "j4_calibration",
        "wrist_calibration",
        "rich_finger",
        "rich_fingers",
        "rich_thumb",
        "rich_wrist",
        "rich_hand",
    }


@pytest.mark.parametrize("name", sorted(known_trajectories()))
def test_what_comes_along_is_safe_and_touches_nothing(name: str) -> None:
    trajectory = load_trajectory(name, HAND)
    commands = trajectory.by_command(HAND)
    assert trajectory.notes == ()
    assert commands.positions[0] == pytest.approx(commands.positions[-1])  # can be repeated at once
    speeds = np.diff(commands.positions, axis=0) / np.diff(commands.times_s)[:, None]
    kinks = np.abs(np.diff(np.vstack([0 * speeds[:1], speeds, 0 * speeds[:1]]), axis=0)) / COMMAND_PERIOD_S
    for column, command in enumerate(commands.joints):
        assert np.abs(speeds[:, column]).max() <= HAND.velocity_limit_rad_s(command)
        assert kinks[:, column].max() <= HAND.acceleration_limit_rad_s2(command)

    model = mujoco.MjModel.from_xml_path(str(HAND.model_path))
    data = mujoco.MjData(model)
    actuators = [model.actuator(HAND.description.commands[command].actuator).id for command in commands.joints]
    times_s = np.arange(0.0, commands.duration_s + 0.5, model.opt.timestep)
    for time_s, targets in zip(times_s, commands.sample(times_s), strict=True):
        data.ctrl[actuators] = targets
        mujoco.mj_step(model, data)
        assert data.ncon == 0, f"contact at {time_s:.2f} s"
    assert np.abs(data.qpos).max() < 5e-3


@pytest.mark.parametrize("name", ["rich_finger", "rich_fingers", "rich_thumb", "rich_wrist", "rich_hand"])
def test_rich_motions_move_their_joints_apart_from_each_other(name: str) -> None:
    commands = load_trajectory(name, HAND).by_command(HAND)
    speeds = np.diff(commands.sample(np.arange(0.0, commands.duration_s, COMMAND_PERIOD_S)), axis=0)
    moving = np.abs(speeds) > 1e-9
    assert moving.any(axis=0).all()
    assert (~moving).mean(axis=0).min() > 0.1  # holds
    together = np.corrcoef(speeds.T) - np.eye(len(commands.joints))
    assert np.abs(together).max() < 0.7
    reversals = [np.count_nonzero(np.diff(np.sign(column[column != 0]))) for column in speeds.T]
    assert min(reversals) >= 4


def test_the_real_files_trajectories_load_as_they_are() -> None:
    if not REAL.is_file():
        pytest.skip(f"{REAL} is not here")
    closing = load_trajectory(f"{REAL}:hand_closing", HAND)
    assert len(closing.joints) == 24
    assert closing.times_s == pytest.approx([0.0, 0.1, 3.1, 6.1])
    ours = load_trajectory("hand_closing", HAND).by_command(HAND)
    theirs = closing.by_command(HAND)
    when = np.linspace(0.0, 6.1, 62)
    for column, name in enumerate(ours.joints):
        assert ours.sample(when)[:, column] == pytest.approx(theirs.sample(when)[:, theirs.joints.index(name)])
    thumb = load_trajectory(f"{REAL}:thumb_calibration", HAND)
    assert thumb.times_s == pytest.approx([0.0, 3.0, 6.0, 7.0])
    assert thumb.sample(np.array([1.5]))[0, thumb.joints.index("rh_THJ4")] == pytest.approx(1.22173 / 2)
    assert "ra_elbow_joint" in refusal(f"{REAL}:arm_trajectory")
    out_of_range = refusal(f"{REAL}:thumb_index_1cm_apart")
    for part in ("waypoint 1", "rh_LFJ2", "0.0000 to 1.5708"):
        assert part in out_of_range
    assert "Did you mean 'hand_closing'?" in refusal(f"{REAL}:hand_closin")
    assert ":NAME" in refusal(REAL)


def test_waypoints_are_reached_after_their_time_and_held(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        """  one:
    start: {rh_FFJ3: 0.1}
    waypoints:
      - {interpolate_time: 1, hold: 0.5, positions: {FFJ3: 0.5, rh_FFJ0: 1.0}}
      - {interpolate_time: 2, positions: {rh_FFJ0: 0.0}}
""",
    )
    one = load_trajectory(path, HAND)  # the only one needs no name
    assert one.name == "one"
    assert one.joints == ("rh_FFJ3", "rh_FFJ0")
    assert one.times_s == pytest.approx([0.0, 1.0, 1.5, 3.5])
    expected = {-1.0: (0.1, 0.0), 0.0: (0.1, 0.0), 0.5: (0.3, 0.5), 1.2: (0.5, 1.0), 2.5: (0.5, 0.5), 9.0: (0.5, 0.0)}
    assert one.sample(np.array(list(expected))) == pytest.approx(np.array(list(expected.values())))
    moved = one.starting_at({"rh_FFJ3": 0.3})
    assert moved.sample(np.array([0.0, 1.0])) == pytest.approx(np.array([[0.3, 0.0], [0.5, 1.0]]))
    assert one.duration_s == 3.5


def test_a_first_waypoint_without_time_is_the_start(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        "  one:\n    - {interpolate_time: 0, hold: 1, positions: {FFJ3: 0.2}}\n"
        "    - {interpolate_time: 1, positions: {FFJ3: 0.4}}\n",
    )
    one = load_trajectory(path, HAND)
    assert one.times_s == pytest.approx([0.0, 1.0, 2.0])
    assert one.positions[:, 0] == pytest.approx([0.2, 0.2, 0.4])


def test_cubic_motions_pass_the_waypoints_at_rest(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        "  one:\n    interpolation: cubic\n    waypoints:\n"
        "      - {interpolate_time: 1, positions: {FFJ3: 1.0}}\n"
        "      - {interpolate_time: 1, positions: {FFJ3: 0.0}}\n",
    )
    one = load_trajectory(path, HAND)
    when = np.array([0.0, 0.25, 0.5, 1.0, 2.0])
    assert one.sample(when)[:, 0] == pytest.approx([0.0, 0.15625, 0.5, 1.0, 0.0], abs=1e-3)
    assert np.abs(np.diff(one.sample(np.array([0.0, 0.01, 0.99, 1.0, 1.01]))[:, 0])[[0, 2, 3]]).max() < 1e-3


def test_listed_joints_give_the_order_of_the_angles(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        "  one: {joints: [rh_MFJ3, rh_FFJ0], waypoints: [{interpolate_time: 1, joint_angles: [0.5, 2.0]}]}\n"
        "  two: [{interpolate_time: 1, joint_angles: [0.7]}]\nhand_joints_order: [THJ1]\n",
    )
    one = load_trajectory(f"{path}:one", HAND)
    assert dict(zip(one.joints, one.positions[-1], strict=True)) == {"rh_MFJ3": 0.5, "rh_FFJ0": 2.0}
    assert load_trajectory(f"{path}:two", HAND).joints == ("rh_THJ1",)


def test_a_rounded_limit_is_clipped_and_noted(tmp_path: Path) -> None:
    path = written(tmp_path, "  one: [{interpolate_time: 1, positions: {FFJ3: 1.571}}]\n")
    one = load_trajectory(path, HAND)
    assert one.positions.max() == HAND.joint_range_rad["rh_FFJ3"][1]
    assert [note.split(":")[0] for note in one.notes] == ["rh_FFJ3"]


@pytest.mark.parametrize(
    ("motion", "expected"),
    [
        ("[{interpolate_time: 1, positions: {FFJ3: 1.9}}]", ["waypoint 1", "rh_FFJ3", "1.9", "-0.2618 to 1.5708"]),
        ("{start: {FFJ3: -2}, waypoints: [{interpolate_time: 1, positions: {FFJ3: 1}}]}", ["start pose", "rh_FFJ3"]),
        (
            "[{interpolate_time: 1, hold: 1, positions: {FFJ0: 1}}, {interpolate_time: 1, positions: {FFJ0: 4}}]",
            ["waypoint 2", "rh_FFJ0"],
        ),
        ("[{interpolate_time: 1, positions: {FFJ8: 1}}]", ["FFJ8", "joint or command"]),
        ("[{interpolate_time: 1, positions: {FFJ3: .nan}}]", ["finite", "waypoints.0.positions.FFJ3"]),
        ("[{interpolate_time: 1, positions: {FFJ3: '1'}}]", ["valid number"]),
        ("[{interpolate_time: -1, positions: {FFJ3: 1}}]", ["waypoints.0.interpolate_time"]),
        ("[{interpolate_time: .inf, positions: {FFJ3: 1}}]", ["waypoints.0.interpolate_time"]),
        (
            "[{interpolate_time: 1, positions: {FFJ3: 1}}, {interpolate_time: 0, positions: {FFJ3: 0}}]",
            ["waypoint 2", "interpolate_time is 0 s"],
        ),
        ("[{interpolate_time: 1, positons: {FFJ3: 1}}]", ["Did you mean 'positions'?"]),
        ("[{interpolate_time: 1}]", ["joint_angles", "positions"]),
        ("[{interpolate_time: 1, positions: {}}]", ["names no joint"]),
        ("[{interpolate_time: 0, positions: {FFJ3: 1}}]", ["lasts 0 s"]),
        ("[{interpolate_time: 1, joint_angles: [0, 1]}]", ["2 numbers", "24"]),
        ("[{interpolate_time: 1, positions: {FFJ3: 1, rh_FFJ3: 1}}]", ["two spellings"]),
        ("[{interpolate_time: 1, positions: {FFJ1: 1}}]", ["without rh_FFJ2", "rh_FFJ0"]),
        ("[{interpolate_time: 1, positions: {FFJ0: 1, FFJ1: 1, FFJ2: 1}}]", ["not both"]),
        ("{interpolation: quintic, waypoints: [{interpolate_time: 1, positions: {FFJ3: 1}}]}", ["interpolation"]),
        ("[]", ["waypoints"]),
        ("3", ["waypoints"]),
    ],
)
def test_a_wrong_trajectory_is_refused_in_one_line(tmp_path: Path, motion: str, expected: list[str]) -> None:
    path = written(tmp_path, f"  bad: {motion}\n  good: [{{interpolate_time: 1, positions: {{FFJ3: 1}}}}]\n")
    line = refusal(f"{path}:bad")
    for part in (*expected, "motions.yaml:bad"):
        assert part in line
    assert load_trajectory(f"{path}:good", HAND).name == "good"  # only the chosen one is checked


def test_references_that_lead_nowhere(tmp_path: Path) -> None:
    assert "Did you mean 'rich_hand'?" in refusal("rich_hnd")
    assert "no such trajectory file" in refusal(tmp_path / "none.yaml")
    assert "no such trajectory file" in refusal(f"{tmp_path / 'none.yaml'}:one")
    (tmp_path / "other.yaml").write_text("a: 1\n")
    assert "no trajectories" in refusal(tmp_path / "other.yaml")
    with pytest.raises(BadInput, match="cannot write"):
        save_trajectory(tmp_path / "absent" / "x.yaml", load_trajectory("index_closing", HAND))


@st.composite
def trajectories(draw: st.DrawFn) -> Trajectory:
    names = draw(st.lists(st.sampled_from(HAND.commands), min_size=1, max_size=5, unique=True))
    ranges = [allowed_range(name, HAND) for name in names]
    steps = draw(st.lists(st.floats(0.002, 50.0), min_size=1, max_size=8))
    poses = st.tuples(*(st.floats(low, high) for low, high in ranges))
    rows = draw(st.lists(poses, min_size=len(steps) + 1, max_size=len(steps) + 1))
    return Trajectory("drawn", tuple(names), np.concatenate([[0.0], np.cumsum(steps)]), np.array(rows))


@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(trajectory=trajectories())
def test_what_is_saved_loads_back_the_same(tmp_path: Path, trajectory: Trajectory) -> None:
    path = tmp_path / "saved.yaml"
    save_trajectory(path, trajectory)
    loaded = load_trajectory(f"{path}:drawn", HAND)
    assert loaded.joints == trajectory.joints
    assert loaded.times_s == pytest.approx(trajectory.times_s, abs=1e-8)
    assert loaded.positions == pytest.approx(trajectory.positions, abs=1e-11)
    assert [entry.name for entry in tmp_path.iterdir()] == ["saved.yaml"]


def test_several_are_saved_in_one_file(tmp_path: Path) -> None:
    both = [load_trajectory(name, HAND) for name in ("index_closing", "rich_wrist")]
    save_trajectory(tmp_path / "both.yaml", both)
    for each in both:
        assert load_trajectory(f"{tmp_path / 'both.yaml'}:{each.name}", HAND).positions == pytest.approx(each.positions)
