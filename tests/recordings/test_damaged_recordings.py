"""Damage of any kind ends in one line that says what to do, or in what could still be read; never in anything else."""

from __future__ import annotations

import gzip
import os
import random
import shutil
from pathlib import Path

import pytest

from twin_daemon.errors import BadInput
from twin_daemon.recordings import load_recording

from .bag_files import JointState, write_bag

START = 1_700_000_000_000_000_000
NAMES = ("rh_FFJ1", "rh_FFJ2")
FORMS = ("bag", "bag_lz4", "mcap", "mcap_file", "mcap_zstd", "sqlite", "db3_file", "csv", "csv.gz", "pair")


def whole(form: str, folder: Path) -> tuple[Path, Path]:
    """(what names the recording, the file to damage)."""
    stamps = [START + i * 1_000_000 for i in range(60)]
    if form.startswith("csv"):
        lines = ["name,position,velocity,effort,timestamp_nsecs"]
        lines += [f'"[\'a\', \'b\']","(1.0, {i}.0)","()","()",{stamp}' for i, stamp in enumerate(stamps)]
        return _text(folder / f"motion.{form}", lines), folder / f"motion.{form}"
    if form == "pair":
        (folder / "joint_list.txt").write_text("a\nb\n")
        for stem in ("control", "state_motor"):
            _text(folder / f"{stem}.csv.gz", ["timestamp,positions", *(f'{i}000,"[1.0, {i}]"' for i in range(60))])
        return folder, folder / "state_motor.csv.gz"
    path = write_bag(form, folder, [JointState(stamp, NAMES, (0.1, 0.2), (1, 2)) for stamp in stamps])
    if path.is_file():
        return path, path
    return path, next(file for file in path.iterdir() if file.suffix in {".mcap", ".db3"})


def _text(path: Path, lines: list[str]) -> Path:
    content = "\n".join(lines).encode()
    path.write_bytes(gzip.compress(content) if path.suffix == ".gz" else content)
    return path


def fine_or_refused(path: Path) -> None:
    try:
        assert load_recording(path).quality.samples > 0
        return
    except BadInput as error:
        line = str(error)
    assert "\n" not in line
    assert str(path) in line
    assert len(line) < 1000


@pytest.mark.parametrize("form", FORMS)
def test_cut_off_anywhere(form: str, tmp_path: Path, rng) -> None:
    path, file = whole(form, tmp_path)
    content = file.read_bytes()
    for length in sorted({0, 1, 7, 8, 16, 37, len(content) - 1, *rng.integers(0, len(content), 12).tolist()}):
        file.write_bytes(content[:length])
        fine_or_refused(path)


@pytest.mark.parametrize("form", FORMS)
def test_bytes_overwritten_anywhere(form: str, tmp_path: Path, rng) -> None:
    path, file = whole(form, tmp_path)
    content = file.read_bytes()
    for _ in range(25):
        damaged = bytearray(content)
        at = int(rng.integers(0, len(content)))
        width = int(rng.choice([1, 4, 8]))
        damaged[at : at + width] = rng.choice([b"\xff" * width, b"\x00" * width, rng.bytes(width)])
        file.write_bytes(damaged)
        fine_or_refused(path)


@pytest.mark.parametrize("suffix", ["bag", "mcap", "db3", "csv", "csv.gz", "txt"])
@pytest.mark.parametrize("start", [b"", b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\x00", b"\x1f\x8b\x08"])
def test_garbage_under_any_name(suffix: str, start: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"x.{suffix}"
    path.write_bytes(start + random.Random(0).randbytes(5000))
    with pytest.raises(BadInput) as caught:
        load_recording(path)
    assert "\n" not in str(caught.value)


def test_huge_declared_lengths_are_not_believed(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(b"\x89MCAP0\r\n\x01" + (2**62).to_bytes(8, "little") + b"\x00" * 100 + b"\x89MCAP0\r\n")
    with pytest.raises(BadInput):
        load_recording(path)
    path = tmp_path / "x.bag"
    path.write_bytes(b"#ROSBAG V2.0\n" + b"\xff" * 4 + b"\x00" * 100)
    with pytest.raises(BadInput):
        load_recording(path)


@pytest.mark.parametrize("form", ["bag", "mcap", "sqlite"])
def test_bags_without_messages(form: str, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="joint_states"):
        load_recording(write_bag(form, tmp_path, []))


@pytest.mark.parametrize(
    "content", ["", "a: [", "[" * 200_000, "rosbag2_bagfile_information: 3", "rosbag2_bagfile_information: {}"]
)
def test_damaged_metadata(content: str, tmp_path: Path) -> None:
    path, _ = whole("mcap", tmp_path)
    (path / "metadata.yaml").write_text(content)
    with pytest.raises(BadInput):
        load_recording(path)
    with pytest.raises(BadInput):
        load_recording(path / "metadata.yaml")


def test_what_is_not_there_or_not_a_file(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="no such file"):
        load_recording(tmp_path / "none.bag")
    with pytest.raises(BadInput, match="holds no recording"):
        load_recording(tmp_path)
    with pytest.raises(BadInput, match="device"):
        load_recording("/dev/null")
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(BadInput, match="pipe"):
        load_recording(tmp_path / "pipe.csv")
    (tmp_path / "x.txt").write_text("hello")
    with pytest.raises(BadInput, match="known form"):
        load_recording(tmp_path / "x.txt")


def test_a_bag_under_another_name_says_how_to_call_it(tmp_path: Path) -> None:
    path, _ = whole("mcap_file", tmp_path)
    shutil.copy(path, tmp_path / "motion.bin")
    with pytest.raises(BadInput, match=r"Rename it to motion\.mcap"):
        load_recording(tmp_path / "motion.bin")
