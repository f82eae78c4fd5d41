"""The twin moves the hand by itself only while somebody answers for it."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from twin_daemon.daemon.automatic import AutomaticRun
from twin_daemon.daemon.consent import Consent, NoConsent, end_of, give, standing, withdraw
from twin_daemon.daemon.schedule import Unfinished
from twin_daemon.errors import BadInput

NOW = datetime(2026, 3, 4, 12, 0, tzinfo=UTC)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "hands" / "consent.json"


def test_it_holds_from_when_it_is_given_to_the_end_of_its_last_day(path: Path) -> None:
    with pytest.raises(NoConsent, match="nobody has consented"):
        standing(path, NOW)
    give(path, "Ann Example", end_of("2026-03-10"), NOW)
    assert "Ann Example" in standing(path, datetime(2026, 3, 10, 23, 59, tzinfo=UTC)).in_words()
    with pytest.raises(NoConsent, match="Ann Example ended"):
        standing(path, datetime(2026, 3, 11, tzinfo=UTC))
    assert withdraw(path)
    assert not withdraw(path)
    with pytest.raises(NoConsent):
        standing(path, NOW)


@pytest.mark.parametrize(("person", "until"), [("", "2026-03-10"), ("Ann", "2026-03-03"), ("Ann", "2028-03-03")])
def test_what_cannot_be_one_is_refused(path: Path, person: str, until: str) -> None:
    with pytest.raises(BadInput):
        give(path, person, end_of(until), NOW)
    assert not path.exists()


@pytest.mark.parametrize("day", ["tomorrow", "2026-02-30", "10.3.2026"])
def test_a_day_is_a_date(day: str) -> None:
    with pytest.raises(BadInput):
        end_of(day)


def test_a_file_that_is_no_consent_is_none(path: Path, tmp_path: Path) -> None:
    give(path, "Ann", end_of("2026-03-10"), NOW)
    whole = path.read_bytes()
    endless = Consent(schema=1, person="Ann", given=NOW, until=NOW + timedelta(days=9999)).model_dump_json(
        by_alias=True
    )
    for content in (b"", b"{}", whole[:-5], b"\xff" * 99, endless.encode()):
        path.write_bytes(content)
        with pytest.raises(NoConsent):
            standing(path, NOW)
    path.unlink()
    elsewhere = tmp_path / "elsewhere.json"
    elsewhere.write_bytes(whole)
    path.symlink_to(elsewhere)
    with pytest.raises(NoConsent):
        standing(path, NOW)


def test_a_run_is_counted_down_and_is_over_when_its_lease_is() -> None:
    run = AutomaticRun(Unfinished("by the clock", [], None), "rich_hand", "automatic", 100.0, 30.0)
    assert "in 30 s" in run.told(100.0)["words"]
    assert run.told(112.0)["begins_in_s"] == 18.0
    assert not run.is_due(129.9)
    assert run.is_due(130.0)
    run.started()
    assert not run.look(None)
    assert not run.look("automatic")
    assert run.told(140.0)["phase"] == "moving"
    assert run.look(None)
