"""What does not arrive, arrives late or bears another clock's stamp is counted for what it is."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from twin_daemon.daemon.events import EventLog
from twin_daemon.daemon.timing import Timing

PERIOD = 8_000_000
OFFSET = 3_000_000_000


def fed(stamps: np.ndarray, delay_ns: np.ndarray | int = 0) -> Timing:
    timing = Timing()
    for stamp, arrival in zip(stamps, stamps + OFFSET + delay_ns, strict=True):
        timing.add(int(stamp), int(arrival))
    return timing


def test_rate_offset_and_jitter_are_those_of_the_stream() -> None:
    delay = np.random.default_rng(0).integers(0, 2_000_000, 500)
    answer = fed(np.arange(500) * PERIOD, delay).as_json()
    assert answer["rate_hz"] == pytest.approx(125.0)
    assert answer["offset_s"] == pytest.approx(3.001, abs=2e-4)
    assert answer["jitter_s"] == pytest.approx(0.00198, abs=1e-4)
    assert (answer["missing"], answer["gaps"], answer["late"], answer["clock_jumps"]) == (0, 0, 0, 0)


def test_missing_messages_are_counted_and_a_pause_is_none() -> None:
    kept = np.array([i for i in range(600) if i not in (100, 200, 201, 202)]) * PERIOD
    kept = np.append(kept, kept[-1] + 60_000_000_000 + np.arange(5) * PERIOD)
    answer = fed(kept).as_json()
    assert (answer["missing"], answer["gaps"]) == (4, 2)


def test_another_rate_is_not_a_loss() -> None:
    stamps = np.concatenate([np.arange(500) * PERIOD, 500 * PERIOD + np.arange(200) * 5 * PERIOD])
    answer = fed(stamps).as_json()
    assert (answer["missing"], answer["gaps"]) == (0, 0)
    assert answer["rate_hz"] == pytest.approx(25.0)


def test_a_burst_after_a_stall_is_late_and_nothing_is_missing() -> None:
    stamps = np.arange(400) * PERIOD
    delay = np.zeros(400, dtype=np.int64)
    delay[200:300] = (300 - np.arange(200, 300)) * PERIOD  # held back, then all at once
    answer = fed(stamps, delay).as_json()
    assert answer["missing"] == 0
    assert 80 <= answer["late"] <= 100
    assert answer["clock_jumps"] == 0


def test_late_is_measured_from_the_fastest_message_lately() -> None:
    delay = np.full(700, 100_000_000)
    delay[40] = 0
    delay[300] = -1_000_000
    counts = [int(fed(np.arange(n) * PERIOD, delay[:n]).counts["late"]) for n in (40, 290, 700)]
    assert counts == [0, 290 - 41, 700 - 42]
    delay[300] = 100_000_000
    assert fed(np.arange(700) * PERIOD, delay).counts["late"] == 512, "the fast one is forgotten"


def test_a_clock_that_is_set_ahead_is_not_a_loss() -> None:
    stamps = np.arange(400) * PERIOD
    jumped = stamps + np.where(np.arange(400) >= 200, 5_000_000_000, 0)
    answer = fed(jumped, stamps - jumped).as_json()
    assert (answer["clock_jumps"], answer["missing"], answer["late"]) == (1, 0, 0)


def test_events_outlive_the_daemon(tmp_path: Path) -> None:
    journal = tmp_path / "deep" / "events.jsonl"
    first = EventLog(journal)
    first.add(1, "drift", "a drifts", {"joint": "a"})
    with journal.open("a") as file:
        file.write('{"stamp_ns": 2, "ki')  # killed while it wrote
    again = EventLog(journal)
    assert [event["text"] for event in again.recent()] == ["a drifts"]
    assert again.take() == []
    again.add(3, "fresh", "joint states arrive")
    assert [event["stamp_ns"] for event in EventLog(journal).recent()] == [1, 3]
    assert json.loads(journal.read_text().splitlines()[0])["joint"] == "a"


def test_a_flood_of_events_is_counted_and_not_written(tmp_path: Path) -> None:
    journal = tmp_path / "events.jsonl"
    log = EventLog(journal)
    for index in range(1000):
        log.add(index * 8_000_000, "anchored", "diverged")
    assert log.counts["anchored"] == 1000
    assert len(journal.read_text().splitlines()) < 20


def test_a_disk_that_cannot_be_written_costs_the_record_only(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    log = EventLog(blocked / "events.jsonl")
    log.add(1, "fresh", "joint states arrive")
    assert [event.kind for event in log.take()] == ["fresh"]
    assert log.counts["not_written"] == 1
