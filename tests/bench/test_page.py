"""The pages of the benchmarks say what was measured, and nothing else."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from bench import dissertation_page, results
from bench.catalogue import BENCHMARKS
from bench.frame import Benchmark, LeftOut, Row, ratio_row
from bench.page import page, row_text

DOCS = Path(__file__).resolve().parents[2] / "docs"

FALLING = Benchmark(
    "falling", "A stone and a feather.", lambda quick, seed: [ratio_row("fall", [1.0, 3.0], [2.0, 2.0], most=0.5)]
)


def test_the_page_of_benchmarks_is_made_of_their_results() -> None:
    assert page(results.read(DOCS / "bench.json")) == (DOCS / "bench.md").read_text()


def test_the_page_of_the_dissertation_is_made_of_its_results() -> None:
    measured = json.loads((DOCS / "dissertation.json").read_text())
    assert dissertation_page.page(measured) == (DOCS / "dissertation.md").read_text()


def test_every_benchmark_is_on_the_page() -> None:
    assert list(results.read(DOCS / "bench.json")) == [benchmark.name for benchmark in BENCHMARKS]


def test_results_say_where_and_with_what_they_were_measured(tmp_path: Path) -> None:
    result = results.measured(FALLING, quick=True, seed=4)
    results.write(tmp_path / "bench.json", {"falling": result})
    assert results.read(tmp_path / "bench.json")["falling"]["rows"][0]["ratio"] == 1.0
    assert result["command"] == "python -m bench --quick --only falling --seed 4"
    assert result["machine"]
    assert result["versions"]["mujoco"]


def test_a_goal_that_is_missed_says_so() -> None:
    missed = results.measured(FALLING, quick=True, seed=0)["rows"][0]
    assert row_text(missed) == "| fall | 2 s | 2 s | 1 | 0.5 to 1.5 | at most 0.5: **not reached** |"
    assert "**not reached**" not in row_text({**missed, "met": True})


def test_what_a_machine_lacks_is_said_on_the_page() -> None:
    def measure(quick: bool, seed: int) -> list[Row]:
        raise LeftOut("no feather is on this machine")

    result = results.measured(replace(FALLING, measure=measure), quick=False, seed=0)
    assert "Left out: no feather is on this machine." in page({"falling": result})


@pytest.mark.parametrize(("spread", "apart"), [((0.4, 0.9), 0), ((1.6, 1.8), 1)])
def test_two_runs_agree_where_their_spreads_meet(spread: tuple[float, float], apart: int) -> None:
    before = results.measured(FALLING, quick=False, seed=0)
    after = {**before, "rows": [{**before["rows"][0], "spread": spread}]}
    assert len(results.disagreements({"falling": before}, {"falling": after})) == apart
