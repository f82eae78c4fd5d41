"""The race of candidates: it goes on where one may be worth its name, and ends where none comes near that."""

from __future__ import annotations

from pathlib import Path

from tests.diagnosis.rig import left_of_rig
from twin_daemon.diagnosis.group import look
from twin_daemon.diagnosis.part_search import begun_outcome
from twin_daemon.diagnosis.race import raced, shortlist
from twin_daemon.diagnosis.screening import Screening


def test_a_race_ends_where_no_candidate_comes_near_what_it_has_to_take(tmp_path: Path) -> None:
    """Play takes nearly all of what is left, and that is all that anything can take."""
    reduced = left_of_rig(tmp_path, "backlash", {"gap": 0.03})
    part = look(reduced)[1]
    screening = Screening(part)
    entered = shortlist(screening, part, begun_outcome(reduced, part), unforced=False)[:8]
    found = raced(screening, entered, 0.5 * screening.cost)
    assert found[0].hypothesis.name in ("backlash:left", "dead_zone:left")
    assert found[0].cost < 0.05 * screening.cost
    assert raced(screening, entered, -20.0 * screening.cost) == []
