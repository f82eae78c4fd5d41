"""The race of candidates: it goes on where one may be worth its name, and ends where none comes near that."""

from __future__ import annotations

from pathlib import Path

from tests.diagnosis.rig import changed_rig
from twin_daemon.diagnosis.group import look
from twin_daemon.diagnosis.part_search import begun_outcome
from twin_daemon.diagnosis.race import raced, shortlist
from twin_daemon.diagnosis.screening import Screening
from twin_daemon.estimation.partition import Reduction
from twin_daemon.hand import load_hand
from twin_daemon.recordings.load import load_recording
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.submodel import drive_groups
from twin_daemon.simulation.twin import TwinModel


def test_a_race_ends_where_no_candidate_comes_near_what_it_has_to_take(tmp_path: Path) -> None:
    """Play takes nearly all of what is left, and that is all that anything can take."""
    model, bag, other = changed_rig(tmp_path, "backlash", {"gap": 0.03}, target="left")
    twin = TwinModel.load(load_hand(model=model))
    train, held = ([align(twin, load_recording(path))] for path in (bag, other))
    group = next(group for group in drive_groups(twin) if "left" in group.joints)
    (reduced,) = Reduction(twin, train, held).each(twin, [(group, ["left"])])
    assert reduced is not None
    part = look(reduced)[1]
    screening = Screening(part)
    entered = shortlist(screening, part, begun_outcome(reduced, part), unforced=False)[:8]
    found = raced(screening, entered, 0.5 * screening.cost)
    assert found[0].hypothesis.name in ("backlash:left", "dead_zone:left")
    assert found[0].cost < 0.05 * screening.cost
    assert raced(screening, entered, -20.0 * screening.cost) == []
