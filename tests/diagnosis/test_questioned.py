"""What is uncertain about a part, fitted again from where a candidate shows that it was not at its best."""

from __future__ import annotations

from pathlib import Path

from tests.diagnosis.rig import changed_rig
from twin_daemon.diagnosis.group import at_nominal, look
from twin_daemon.diagnosis.part_search import PartSearch
from twin_daemon.estimation.partition import Reduction
from twin_daemon.hand import load_hand
from twin_daemon.recordings.load import load_recording
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.submodel import drive_groups
from twin_daemon.simulation.twin import TwinModel


def test_a_part_that_a_candidate_fits_better_by_no_effect_is_looked_at_again(tmp_path: Path) -> None:
    """A servo's gain is 8 % off, as nominal values may be: with all of them at nominal values something is missing."""
    model, bag, other = changed_rig(tmp_path, "actuator_gain", {"factor": 0.92}, target="left")
    twin = TwinModel.load(load_hand(model=model))
    train, held = ([align(twin, load_recording(path))] for path in (bag, other))
    group = next(group for group in drive_groups(twin) if "left" in group.joints)
    (reduced,) = Reduction(twin, train, held).each(twin, [(group, ["left"])])
    assert reduced is not None
    search = PartSearch(at_nominal(reduced)[1], reduced, 0, lambda _: None, 4)
    assert not search.as_it_is().within_floor
    better = look(reduced)[1].base
    again = search.questioned(better)
    assert again is not None
    assert again.as_it_is().within_floor
    assert again.questioned(better) is None
