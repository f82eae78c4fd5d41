"""One journal for decisions, audit and events: chained, honest about damage, and it goes on with earlier files."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin_daemon.daemon.events import EventLog
from twin_daemon.gate.audit import AuditLog, verify
from twin_daemon.journal import Journal, chained, last_line, lines
from twin_daemon.versions.decisions import Decision, append, last_decision, read_decisions

EARLIER = Path(__file__).with_name("earlier")


@pytest.fixture
def earlier(tmp_path: Path) -> Path:
    """A file of each kind as an earlier release left it."""
    for path in EARLIER.iterdir():
        shutil.copy(path, tmp_path)
    return tmp_path


def written(path: Path, count: int) -> None:
    with Journal(path) as journal:
        for number in range(count):
            journal.append({"number": number, "text": "ü" * number})


@given(st.data())
def test_a_bit_that_flips_anywhere_shows(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    path = tmp_path_factory.mktemp("journal") / "journal.jsonl"
    written(path, 3)
    content = bytearray(path.read_bytes())
    place = data.draw(st.integers(0, len(content) - 2))  # without its end the last line is one that was torn
    content[place] ^= 1 << data.draw(st.integers(0, 6))
    path.write_bytes(content)
    assert any(line.entry is None or not line.follows for line in lines(path))


def test_what_follows_a_torn_line_names_it_and_is_read(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    written(path, 2)
    with path.open("ab") as file:
        file.write(b'{"number": 2, "te')
    assert last_line(path) is None
    written(path, 1)
    assert [line.torn for line in lines(path)] == [False, False, True, False]
    assert [line.entry["number"] for line in lines(path) if line.entry is not None] == [0, 1, 0]
    assert all(line.follows for line in lines(path))


def test_a_journal_can_be_made_at_once(tmp_path: Path) -> None:
    written(tmp_path / "one", 4)
    entries = [line.entry or {} for line in lines(tmp_path / "one")]
    assert chained(entries) == (tmp_path / "one").read_bytes()


def test_a_line_longer_than_the_end_that_is_read_first_is_found(tmp_path: Path) -> None:
    with Journal(tmp_path / "one") as journal:
        journal.append({"text": "x"})
        journal.append({"text": "y" * 300_000})
    with Journal(tmp_path / "one") as journal:
        journal.append({"text": "z"})
    assert all(line.follows and line.entry for line in lines(tmp_path / "one"))


def test_decisions_of_an_earlier_release_are_gone_on_with(earlier: Path) -> None:
    path = earlier / "decisions.jsonl"
    found = read_decisions(path)
    assert (found.problems, found.whole_bytes) == ((), path.stat().st_size)
    assert [decision.what for decision in found.decisions] == ["stored", "promoted", "noted"]
    assert found.last == last_decision(path)
    assert found.last is not None
    assert found.last.text == "neue Sehne, größer"
    append(path, Decision(4, "2026-11-04T10:00:00+00:00", "noted", version="a" * 64, text="greased"))
    again = read_decisions(path)
    assert again.problems == ()
    assert again.decisions[:3] == found.decisions
    assert again.last == last_decision(path)


@pytest.mark.parametrize(("line", "wanted"), [(0, "line 1 is not"), (1, "line 2 is not"), (2, "line 3 is not")])
def test_a_changed_decision_of_an_earlier_release_is_found(earlier: Path, line: int, wanted: str) -> None:
    path = earlier / "decisions.jsonl"
    raw = path.read_text(encoding="utf-8").splitlines(keepends=True)
    raw[line] = raw[line].replace("2026", "2025")
    path.write_text("".join(raw), encoding="utf-8")
    (problem,) = read_decisions(path).problems
    assert wanted in problem


def test_a_decision_of_an_earlier_release_that_is_missing_is_missed(earlier: Path) -> None:
    path = earlier / "decisions.jsonl"
    first, _, last = path.read_text(encoding="utf-8").splitlines(keepends=True)
    path.write_text(first + last, encoding="utf-8")
    (problem,) = read_decisions(path).problems
    assert "lines are missing before line 2" in problem


def test_an_audit_log_of_an_earlier_release_is_gone_on_with(earlier: Path) -> None:
    path = earlier / "audit.jsonl"
    assert (verify(path).entries, verify(path).broken) == (3, ())
    log = AuditLog(path)
    log.write(2000, {"verb": "stop", "who": "bob", "accepted": True})
    log.close()
    assert (verify(path).entries, verify(path).broken) == (4, ())
    path.write_bytes(path.read_bytes().replace(b'"ann"', b'"eve"', 1))
    assert [broken.line for broken in verify(path).broken] == [2]


def test_events_of_an_earlier_release_are_gone_on_with(earlier: Path) -> None:
    path = earlier / "events.jsonl"
    EventLog(path).add(3, "drift", "b drifts")
    again = EventLog(path).recent()
    assert [event["text"] for event in again] == ["a drifts", "joint states arrive", "b drifts"]
    assert again[-1].keys() == {"schema", "stamp_ns", "kind", "text"}
    assert all(line.follows for line in lines(path))
    assert "prev" in json.loads(path.read_bytes().splitlines()[-1])
