"""A little of `python -m bench.fuzz`: whatever others write is read or refused, never more."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.fuzz import SHARES, run
from bench.fuzz_targets import TARGETS, damaged

FEW = {"cdr": 300, "requests": 200, "yaml": 40, "config": 40, "recordings": 120, "mjcf": 120}


@pytest.mark.parametrize("name", FEW)
def test_hostile_inputs_are_read_or_refused(name: str, tmp_path: Path) -> None:
    counts = run(name, FEW[name], 1, tmp_path)
    assert counts.total() >= FEW[name] // 2
    assert counts["refused"] > 0


def test_every_target_has_its_share() -> None:
    assert set(SHARES) == set(TARGETS) == set(FEW)
    assert sum(SHARES.values()) == pytest.approx(1.0)


@pytest.mark.parametrize("kind", ["flip", "cut", "insert", "zero", "huge"])
def test_damage_is_damage(kind: str) -> None:
    assert damaged(b"a whole message", [(3, kind, b"\x01\x02")]) != b"a whole message"
