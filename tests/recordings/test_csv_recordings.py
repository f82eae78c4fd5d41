"""CSV files: joint states a line, and pairs of control and state."""

from __future__ import annotations

import csv
import gzip
import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin_daemon.errors import BadInput
from twin_daemon.recordings import load_joint_map, load_recording
from twin_daemon.recordings.csv_cells import numbers
from twin_daemon.recordings.joint_state_csv import split_line

START = 1_678_993_486_702_788_012
HEADER = ["name", "position", "velocity", "effort", "timestamp_nsecs"]


def joint_states(path: Path, rows: list[list[object]], header: list[str] | None = None) -> Path:
    text = io.StringIO()
    csv.writer(text).writerows([header or HEADER, *rows])
    if path.suffix == ".gz":
        path.write_bytes(gzip.compress(text.getvalue().encode()))
    else:
        path.write_text(text.getvalue())
    return path


def row(index: int, **changes: object) -> list[object]:
    cells = {
        "name": ["a", "b"],
        "position": (0.1 * index, -1.5e-3),
        "velocity": (1.0, 2.0),
        "effort": (3.0, float(index)),
        "timestamp_nsecs": START + index * 8_000_000,
    }
    return list((cells | changes).values())


@pytest.mark.parametrize("name", ["motion.csv", "motion.csv.gz"])
def test_values_are_read_exactly(name: str, tmp_path: Path) -> None:
    recording = load_recording(joint_states(tmp_path / name, [row(i) for i in range(30)]))
    assert recording.name == "motion"
    assert recording.joints == ("a", "b")
    np.testing.assert_array_equal(recording.stamp_ns, [START + i * 8_000_000 for i in range(30)])
    np.testing.assert_array_equal(recording.position, [(0.1 * i, -1.5e-3) for i in range(30)])
    assert recording.velocity is not None
    assert recording.effort is not None
    np.testing.assert_array_equal(recording.effort[:, 1], np.arange(30))


def test_velocity_and_effort_may_be_missing_and_other_columns_are_not_looked_at(tmp_path: Path) -> None:
    rows = [[i, f"({i}.5,)", "x,y", "['a']", START + i] for i in range(5)]
    path = joint_states(tmp_path / "m.csv", rows, ["n", "position", "comment", "name", "timestamp_nsecs"])
    recording = load_recording(path)
    assert recording.velocity is None
    assert recording.effort is None
    np.testing.assert_array_equal(recording.position[:, 0], np.arange(5) + 0.5)


def test_bad_lines_are_counted_and_never_evaluated(tmp_path: Path) -> None:
    rows = [
        row(0),
        row(1, position="__import__('os').abort()"),
        row(2, position="(1.0, __import__('os').abort())"),
        row(3, name="[x for x in 'ab']"),
        row(4, position="(1.0,)"),
        row(5, timestamp_nsecs="soon"),
        row(6, timestamp_nsecs=10**30),
        row(7, velocity="(1.0,)"),
        row(8, position="(nan, 1.0)"),
        row(8),
        row(2),
        ["['a', 'b']"],
        row(9),
    ]
    quality = load_recording(joint_states(tmp_path / "m.csv", rows)).quality
    assert quality.dropped == {
        "undecodable": 6,
        "wrong_length": 1,
        "velocity_wrong_length": 1,
        "nan": 1,
        "duplicate": 1,
        "backward": 1,
    }
    assert quality.messages == len(rows) == quality.samples + quality.dropped_messages


def test_lines_of_any_csv_dialect_are_read(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    path.write_bytes(
        b"\xef\xbb\xbfname,position,timestamp_nsecs,comment\r\n"
        b"\"['a', 'b']\",\"(1.0,\n 2.0)\",10,plain\r\n"
        b'"[""a"", ""b""]","(3.0, 4.0)",20,"quoted ""twice"""\r\n'
        b"\r\n"
        b"['a'],[5.0],30,\r\n"
    )
    recording = load_recording(path)
    np.testing.assert_array_equal(recording.position, [(1, 2), (3, 4), (5, np.nan)])


@settings(max_examples=200, deadline=None)
@given(
    st.lists(
        st.one_of(
            st.floats().map(repr),
            st.floats(allow_nan=False, allow_infinity=False).map(lambda value: f"{value:.25g}"),
            st.integers(-(10**20), 10**20).map(str),
            st.sampled_from([".5", "1.", "+2", "1e400", "nan", "-inf", " 3 "]),
        ),
        min_size=1,
        max_size=6,
    ),
    st.sampled_from(["[{}]", "({})", "({},)", " [ {} ] "]),
)
def test_numbers_are_what_python_makes_of_them(written: list[str], form: str) -> None:
    read = numbers(form.format(", ".join(written)))
    np.testing.assert_array_equal(np.array(read, dtype=float), [float(text) for text in written])


@pytest.mark.parametrize(
    "cell", ["[true]", "[null, 1]", '["1"]', "[[1]]", "[{}]", "[1", "1, 2", "[1, , 2]", "[1 2]", "{1}"]
)
def test_what_is_no_list_of_numbers_is_refused(cell: str) -> None:
    with pytest.raises(ValueError):
        numbers(cell)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.text(st.sampled_from("ab,\"'[] ()"), max_size=6), min_size=1, max_size=5), st.booleans())
def test_splitting_at_quotes_gives_what_the_csv_module_gives(cells: list[str], quote_all: bool) -> None:
    text = io.StringIO()
    csv.writer(text, quoting=csv.QUOTE_ALL if quote_all else csv.QUOTE_MINIMAL, lineterminator="").writerow(cells)
    split = split_line(text.getvalue())
    assert split is None or split == next(csv.reader([text.getvalue()])) == cells


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "empty"),
        (b"a,b,c\n1,2,3\n", "no column"),
        (b"name,position,timestamp_nsecs\n", "usable"),
        (b"name,position,timestamp_nsecs\n" + b"\x00\xff\xfe" * 100, "damaged"),
        (b"x" * 5_000_000, "characters"),
    ],
)
def test_what_is_no_recording_is_refused_in_one_line(content: bytes, says: str, tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    path.write_bytes(content)
    with pytest.raises(BadInput, match=says) as caught:
        load_recording(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def pair(folder: Path, *, packed: bool = True, joints_above: bool = True) -> Path:
    motion = folder / "wave"
    motion.mkdir()
    (folder if joints_above else motion).joinpath("joint_list.txt").write_text("Rotation\nJaw\n\n")
    state = ["type,timestamp,positions,velocities,torques"]
    control = ["type,timestamp,positions"]
    for i in range(10):
        at = i * 20_000.25
        state.append(f'STATE_MOTOR,{at},"[{i / 10}, 1.0]","[0.5, 0.0]","[0.0, {i}.0]"')
        control.append(f'CONTROL,{at},"[{i / 5}, 2.0]"')
    for stem, content in (("state_motor", state), ("control", control)):
        text = "\n".join(content).encode()
        if packed:
            (motion / f"{stem}.csv.gz").write_bytes(gzip.compress(text))
        else:
            (motion / f"{stem}.csv").write_bytes(text)
    return motion


@pytest.mark.parametrize("packed", [True, False])
@pytest.mark.parametrize("joints_above", [True, False])
def test_a_pair_gives_measurements_and_commands(packed: bool, joints_above: bool, tmp_path: Path) -> None:
    recording = load_recording(pair(tmp_path, packed=packed, joints_above=joints_above))
    assert recording.name == "wave"
    assert recording.joints == ("Rotation", "Jaw")
    np.testing.assert_array_equal(recording.stamp_ns, [i * 20_000_250 for i in range(10)])
    assert recording.effort is not None
    assert recording.effort[9, 1] == 9.0
    assert recording.commands is not None
    assert recording.commands.interpolation == "hold"
    np.testing.assert_array_equal(recording.commands.position[:, 0], [i / 5 for i in range(10)])


def test_a_pair_may_be_named_by_one_of_its_files(tmp_path: Path) -> None:
    motion = pair(tmp_path)
    assert load_recording(motion / "control.csv.gz").sha256 == load_recording(motion).sha256


def test_a_pair_without_joint_list_says_so(tmp_path: Path) -> None:
    motion = pair(tmp_path)
    (tmp_path / "joint_list.txt").unlink()
    with pytest.raises(BadInput, match=r"joint_list\.txt"):
        load_recording(motion)


def test_a_pair_without_commands_is_a_recording_with_a_note(tmp_path: Path) -> None:
    motion = pair(tmp_path)
    (motion / "control.csv.gz").unlink()
    recording = load_recording(motion)
    assert recording.commands is None
    assert any("control.csv" in note for note in recording.quality.notes)


def test_a_joint_map_renames_joints_and_commands(tmp_path: Path) -> None:
    path = tmp_path / "map.yaml"
    path.write_text("# data: model\nRotation: shoulder_pan\nWrist: wrist\n")
    recording = load_recording(pair(tmp_path), load_joint_map(path))
    assert recording.joints == ("shoulder_pan", "Jaw")
    assert recording.commands is not None
    assert recording.commands.names == ("shoulder_pan", "Jaw")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("", "empty"),
        ("- a\n", "mapping"),
        ("a: 1\n", "a"),
        ("a: x\nb: x\n", "two names"),
        ("a: [\n", "YAML"),
    ],
)
def test_a_joint_map_that_says_something_else_is_refused(content: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "map.yaml"
    path.write_text(content)
    with pytest.raises(BadInput, match=says):
        load_joint_map(path)
    with pytest.raises(BadInput, match="No such file"):
        load_joint_map(tmp_path / "none.yaml")


@pytest.mark.parametrize("joint_map", [{"Rotatoin": "shoulder_pan"}, {"Rotation": "Jaw"}])
def test_a_joint_map_that_cannot_be_meant_is_refused(joint_map: dict[str, str], tmp_path: Path) -> None:
    with pytest.raises(BadInput):
        load_recording(pair(tmp_path), joint_map)
