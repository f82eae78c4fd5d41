"""What is uncertain about a part, fitted again from where a candidate shows that it was not at its best."""

from __future__ import annotations

from pathlib import Path

from tests.diagnosis.rig import left_of_rig
from twin_daemon.diagnosis.group import at_nominal, look
from twin_daemon.diagnosis.part_search import PartSearch


def test_a_part_that_a_candidate_fits_better_by_no_effect_is_looked_at_again(tmp_path: Path) -> None:
    """A servo's gain is 8 % off, as nominal values may be: with all of them at nominal values something is missing."""
    reduced = left_of_rig(tmp_path, "actuator_gain", {"factor": 0.92})
    search = PartSearch(at_nominal(reduced)[1], reduced, 0, lambda _: None, 4)
    assert not search.as_it_is().within_floor
    better = look(reduced)[1].base
    again = search.questioned(better)
    assert again is not None
    assert again.as_it_is().within_floor
    assert again.questioned(better) is None
