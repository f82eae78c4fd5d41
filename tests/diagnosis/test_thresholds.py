"""Every number that estimation and diagnosis decide by has one home, a unit and an origin, and stands in the docs."""

from __future__ import annotations

import ast
import pickle
from pathlib import Path

import pytest

from twin_daemon.changes import thresholds as of_changes
from twin_daemon.diagnosis import thresholds as of_diagnosis
from twin_daemon.diagnosis.threshold_page import entries, page
from twin_daemon.estimation import thresholds as of_estimation
from twin_daemon.proposals import thresholds as of_proposals

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("estimation", "calibration", "diagnosis", "changes", "proposals")
EVERY = [one for module in (of_estimation, of_diagnosis, of_changes, of_proposals) for one in entries(module)]


def test_the_page_is_what_the_code_has() -> None:
    made = page(("Changes since an earlier session", of_changes), ("Proposals", of_proposals))
    assert (ROOT / "docs" / "thresholds.md").read_text(encoding="utf-8") == made


@pytest.mark.parametrize(("name", "one"), EVERY)
def test_a_threshold_has_a_unit_and_an_origin(name: str, one: of_estimation.Threshold) -> None:
    assert one.unit
    assert one.why
    for ending, unit in (("_RAD_S", "rad/s"), ("_S", "s"), ("_RAD", "rad"), ("_NATS", "nats"), ("_HZ", "Hz")):
        if name.endswith(ending):
            assert one.unit == unit
            break
    again = pickle.loads(pickle.dumps(one))
    assert (again, again.unit, again.why) == (one, one.unit, one.why)


def test_no_module_keeps_a_number_of_its_own() -> None:
    kept = [
        f"{path.name}: {ast.unparse(node)}"
        for package in PACKAGES
        for path in (ROOT / "twin_daemon" / package).rglob("*.py")
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.Assign) and any(map(_is_number, getattr(node.value, "elts", [node.value])))
    ]
    assert kept == []


def _is_number(value: ast.expr) -> bool:
    """Whether an expression is made of numbers alone, outside of calls."""
    if isinstance(value, ast.BinOp):
        return _is_number(value.left) and _is_number(value.right)
    if isinstance(value, ast.UnaryOp):
        return _is_number(value.operand)
    return isinstance(value, ast.Constant) and isinstance(value.value, (int, float))
