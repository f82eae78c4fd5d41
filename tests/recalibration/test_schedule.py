"""When a recalibration is due, with a clock that the tests move."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from twin_daemon.daemon.schedule import Schedule, Unfinished
from twin_daemon.recalibration.settings import RecalibrationSettings

NOON = datetime(2026, 3, 4, 12, 0, tzinfo=UTC)  # a Wednesday

RUN = Unfinished("by the clock", ["rh_FFJ3"], "kept.mcap")


def schedule(tmp_path: Path, now: datetime = NOON, **settings: Any) -> Schedule:
    given = {"mode": "passive", "on_drift": False, **settings}
    return Schedule(RecalibrationSettings(**given), tmp_path / "schedule.json", now)


def hours(count: float) -> timedelta:
    return timedelta(hours=count)


def test_off_means_never(tmp_path: Path) -> None:
    made = schedule(tmp_path, mode="off", interval_hours=1.0, on_drift=True)
    made.drifted("rh_FFJ3", 1)
    assert made.due(NOON + hours(1000)) is None
    assert "off" in made.in_words(NOON)


def test_by_interval_and_cron_whichever_comes_first(tmp_path: Path) -> None:
    made = schedule(tmp_path, interval_hours=30.0, cron="0 3 * * *")
    assert made.due(NOON + hours(14.9)) is None
    assert made.due(NOON + hours(15.1)) == "by the clock"
    assert "Thursday, 05 March at 03:00 UTC" in made.in_words(NOON)
    made.begun(NOON + hours(15.1), RUN)
    assert made.due(NOON + hours(30.0)) is None


def test_missed_runs_count_once_and_outlive_the_daemon(tmp_path: Path) -> None:
    schedule(tmp_path, cron="0 3 * * *")
    later = NOON + timedelta(days=9)
    again = schedule(tmp_path, later, cron="0 3 * * *")
    assert again.due(later) == "by the clock"
    again.begun(later, RUN)
    assert again.due(later + hours(1)) is None
    assert schedule(tmp_path, later, cron="0 3 * * *").due(later + hours(1)) is None


def test_hours_of_motion_are_kept(tmp_path: Path) -> None:
    made = schedule(tmp_path, motion_hours=2.0)
    made.moved(3600.0)
    made.save()
    again = schedule(tmp_path, NOON, motion_hours=2.0)
    assert again.due(NOON + hours(1)) is None
    again.moved(3700.0)
    assert again.due(NOON + hours(1)) == "2.0 h of motion"


def test_drift_waits_for_the_quiet_hours_to_end(tmp_path: Path) -> None:
    made = schedule(tmp_path, on_drift=True, quiet="22:00-06:00")
    made.drifted("rh_FFJ3", 1)
    made.drifted("rh_FFJ3", 1)
    assert made.due(NOON + hours(11)) is None
    assert made.due(NOON + hours(17.9)) is None
    assert made.due(NOON + hours(18.1)) == "rh_FFJ3 drifted"


def test_one_run_serves_all_and_the_next_keeps_its_distance(tmp_path: Path) -> None:
    made = schedule(tmp_path, on_drift=True, least_minutes=10.0)
    made.drifted("rh_FFJ3", 1)
    made.begun(NOON, RUN)
    made.drifted("rh_MFJ3", 1)
    assert made.due(NOON + timedelta(minutes=9)) is None
    assert made.due(NOON + timedelta(minutes=11)) == "rh_MFJ3 drifted"


def test_a_run_that_a_restart_cut_short_is_known_until_it_has_ended(tmp_path: Path) -> None:
    schedule(tmp_path).begun(NOON, RUN)
    again = schedule(tmp_path)
    assert again.unfinished == RUN
    again.ended()
    assert schedule(tmp_path).unfinished is None


def test_what_could_not_begin_stays_due_and_is_tried_again_later(tmp_path: Path) -> None:
    made = schedule(tmp_path, on_drift=True, motion_hours=1.0, least_minutes=10.0)
    made.begun(NOON - hours(1), RUN)
    made.drifted("rh_FFJ3", 1)
    made.moved(4000.0)
    made.postponed(NOON)
    assert made.due(NOON + timedelta(minutes=9)) is None
    assert made.due(NOON + timedelta(minutes=11)) == "rh_FFJ3 drifted"
    assert made.motion_s == 4000.0
    assert made.due(NOON - timedelta(minutes=30)) == "rh_FFJ3 drifted", "a clock that was set back waits no longer"


def test_a_clock_that_was_set_back_holds_nothing_up(tmp_path: Path) -> None:
    made = schedule(tmp_path, interval_hours=2.0)
    made.begun(NOON + timedelta(days=1), RUN)
    back = NOON
    assert made.due(back) is None
    assert made.due(back + hours(2.1)) == "by the clock"


def test_a_broken_file_begins_anew(tmp_path: Path) -> None:
    (tmp_path / "schedule.json").write_text("{")
    assert schedule(tmp_path, interval_hours=2.0).due(NOON + hours(1)) is None


@pytest.mark.parametrize(
    "wrong", [{"cron": "0 3 * * 0"}, {"cron": "0 25 * * *"}, {"quiet": "22-06"}, {"interval_hours": 0.0}]
)
def test_what_cannot_be_meant_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        RecalibrationSettings(**wrong)
