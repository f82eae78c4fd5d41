"""An id stands for its content, however that content was spelled."""

from __future__ import annotations

import json
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from twin_daemon.versions import Draft, Version, VersionStore, seal

finite = st.floats(allow_nan=False, allow_infinity=False)
json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**53), 2**53) | finite | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=10,
)


def of(terms: dict) -> Draft:
    return Draft(hand="hand", kind="calibrated", terms=terms)


def test_the_same_content_has_one_id_and_another_has_another(draft: Callable[..., Draft], mjcf: str) -> None:
    first, again = seal(draft(), mjcf), seal(draft(), mjcf)
    assert first.id == again.id
    assert first.created <= again.created
    assert seal(draft(0.2), mjcf).id != first.id
    assert seal(draft(note="on the bench"), mjcf).id != first.id
    assert seal(draft(), mjcf + " ").id != first.id


@given(st.dictionaries(st.text(), json_values, max_size=5))
def test_an_id_survives_files_and_the_order_of_keys(terms: dict) -> None:
    version = seal(of(terms), "<mujoco/>")
    stored = json.loads(json.dumps(version.as_json()))
    backwards = {key: stored[key] for key in reversed(stored)}
    assert Version.model_validate(backwards).content_id() == version.id
    assert seal(of(dict(reversed(terms.items()))), "<mujoco/>").id == version.id


@given(finite)
def test_an_id_does_not_depend_on_who_held_the_number(value: float) -> None:
    ids = {seal(of({"value": held}), "<mujoco/>").id for held in (value, np.float64(value), float(repr(value)))}
    assert len(ids) == 1


@pytest.mark.parametrize("value", [math.nan, math.inf, np.float64("nan"), np.array([1.0, math.nan])])
def test_an_undefined_number_is_never_stored(value: object, draft: Callable[..., Draft], mjcf: str) -> None:
    with pytest.raises(ValueError, match=r"terms\.depth"):
        seal(draft(terms={"depth": value}), mjcf)


def test_an_unknown_key_is_an_error(draft: Callable[..., Draft]) -> None:
    with pytest.raises(ValidationError, match="dampling"):
        draft(dampling=1.0)


def test_a_version_says_what_made_it(draft: Callable[..., Draft], mjcf: str, store: VersionStore) -> None:
    version = store.add(draft(), mjcf)
    assert {"twin_daemon", "mujoco", "numpy", "python"} <= version.program.keys()
    assert version.created.endswith("+00:00")
