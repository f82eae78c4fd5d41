"""A benchmark into a folder that is not there yet."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

import bench.__main__ as command
from bench import results
from bench.catalogue import BENCHMARKS
from bench.frame import LeftOut


def test_a_run_of_one_benchmark_makes_the_folder_and_its_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def measure(quick: bool, seed: int) -> list:
        raise LeftOut("nothing is measured in a test")

    monkeypatch.setattr(command, "BENCHMARKS", [replace(one, measure=measure) for one in BENCHMARKS])
    name, folder = BENCHMARKS[0].name, tmp_path / "not" / "there"
    monkeypatch.setattr(sys, "argv", ["bench", "--only", name, "--folder", str(folder)])
    monkeypatch.setenv("TWIN_STATE_DIR", str(tmp_path))
    assert command.main() == 0
    assert list(results.read(folder / "bench.json")) == [name]
    assert (folder / "bench.md").is_file()
