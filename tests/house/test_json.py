"""One JSON object for programs, whatever a command reports."""

from __future__ import annotations

import dataclasses
import enum
import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin_daemon.cli.console import emit_json, plain_text
from twin_daemon.errors import BadInput
from twin_daemon.jsonable import canonical, plain

values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=20,
)


class Verdict(enum.Enum):
    EXPLAINED = "explained"


@dataclasses.dataclass
class Finding:
    verdict: Verdict
    path: Path
    values: np.ndarray


def test_results_become_plain_json() -> None:
    finding = Finding(Verdict.EXPLAINED, Path("a/b"), np.array([1.0, np.nan]))
    assert plain({"finding": finding, "count": np.int64(3), 4: (np.float32(0.5), math.inf)}) == {
        "finding": {"verdict": "explained", "path": "a/b", "values": [1.0, None]},
        "count": 3,
        "4": [0.5, None],
    }


def test_what_has_no_json_form_is_an_error() -> None:
    with pytest.raises(TypeError, match="object"):
        plain({"a": object()})


@settings(max_examples=50)
@given(st.dictionaries(st.text(), values))
def test_any_result_is_strict_json(result: dict) -> None:
    json.loads(json.dumps(plain(result), allow_nan=False))


@settings(max_examples=50)
@given(st.dictionaries(st.text(), values))
def test_canonical_bytes_do_not_depend_on_the_order_of_keys(result: dict) -> None:
    backwards = dict(reversed(result.items()))
    assert canonical(backwards) == canonical(result)
    assert canonical(json.loads(canonical(result))) == canonical(result)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_canonical_bytes_do_not_depend_on_who_held_the_number(value: float) -> None:
    assert canonical([value]) == canonical([np.float64(value)]) == canonical([float(repr(value))])


@given(st.integers(-(2**53) + 1, 2**53 - 1))
def test_whole_numbers_have_one_spelling(value: int) -> None:
    assert canonical(value) == canonical(float(value)) == canonical(np.int64(value))


def test_a_file_gets_one_object_with_a_schema(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    path.write_text("what was there before is longer than what comes", encoding="utf-8")
    emit_json(path, {"mse_rad2": math.nan})
    assert json.loads(path.read_text(encoding="utf-8")) == {"schema": 1, "mse_rad2": None}
    assert list(tmp_path.iterdir()) == [path]


def test_a_dash_is_standard_output(capsys: pytest.CaptureFixture[str]) -> None:
    emit_json("-", {"a": 1})
    assert json.loads(capsys.readouterr().out) == {"schema": 1, "a": 1}


def test_a_device_is_written_and_stays_a_device() -> None:
    emit_json("/dev/null", {"a": 1})
    assert Path("/dev/null").is_char_device()


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    path.write_text("old", encoding="utf-8")
    with pytest.raises(TypeError):
        emit_json(path, {"a": object()})
    assert path.read_text(encoding="utf-8") == "old"


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="absent"):
        emit_json(tmp_path / "absent" / "result.json", {})


def test_names_from_files_are_no_markup() -> None:
    from rich.text import Text

    assert Text.from_markup(plain_text("run[red]_1[/red]")).plain == "run[red]_1[/red]"
