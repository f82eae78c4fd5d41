"""A difference is told in numbers and in words."""

from __future__ import annotations

from collections.abc import Callable

from twin_daemon.versions import Draft, VersionStore, diff


def backlash(width: float) -> dict:
    return {"effect": "backlash", "target": "rh_FFJ3", "values": {"width": width}}


def terms(*effects: dict, **parameters: float) -> dict:
    return {"schema": 1, "parameters": parameters, "effects": list(effects)}


def test_nothing_differs_from_itself(store: VersionStore, draft: Callable[..., Draft], mjcf: str) -> None:
    version = store.add(draft(), mjcf)
    assert diff(version, version).words == ()


def test_a_fitted_number_comes_with_intervals_and_ratio(
    store: VersionStore, draft: Callable[..., Draft], mjcf: str
) -> None:
    change = diff(store.add(draft(0.1), mjcf), store.add(draft(0.2), mjcf))
    (damping,) = change.parameters
    assert (damping.before, damping.after, damping.ratio, damping.intervals_overlap) == (0.1, 0.2, 2.0, False)
    assert (
        damping.words
        == "FFJ3.damping: 0.1 [0.09, 0.11] → 0.2 [0.19, 0.21] N m s/rad (×2; the intervals do not overlap)"
    )
    near = diff(store.add(draft(0.1), mjcf), store.add(draft(0.105), mjcf)).parameters[0]
    assert near.intervals_overlap


def test_effects_that_came_went_and_changed(store: VersionStore, draft: Callable[..., Draft], mjcf: str) -> None:
    without = store.add(draft(terms=terms(), parameters={}), mjcf)
    narrow = store.add(draft(terms=terms(backlash(0.01)), parameters={}), mjcf)
    wide = store.add(draft(terms=terms(backlash(0.02)), parameters={}), mjcf)
    assert diff(without, narrow).words == ("added backlash at rh_FFJ3 (width 0.01)",)
    assert diff(narrow, without).words == ("removed backlash at rh_FFJ3 (width 0.01)",)
    assert diff(narrow, wide).words == ("backlash at rh_FFJ3: width 0.01 → width 0.02",)


def test_a_parameter_only_one_side_sets(store: VersionStore, draft: Callable[..., Draft], mjcf: str) -> None:
    without = store.add(draft(terms=terms(), parameters={}), mjcf)
    held = store.add(draft(terms=terms(**{"FFJ3.armature": 0.5}), parameters={}), mjcf)
    (armature,) = diff(without, held).parameters
    assert (armature.before, armature.after, armature.ratio) == (None, 0.5, None)
    assert diff(without, held).words == ("FFJ3.armature set: 0.5",)
    assert diff(held, without).words == ("FFJ3.armature no longer set: 0.5",)
