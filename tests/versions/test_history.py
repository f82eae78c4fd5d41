"""Where a hand is heading, by its promoted versions."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from twin_daemon.cli.app import main
from twin_daemon.errors import BadInput
from twin_daemon.figures.difference import difference_figure
from twin_daemon.figures.history import history_figure
from twin_daemon.hand import load_hand
from twin_daemon.versions import Draft, ParameterRecord, VersionStore, diff
from twin_daemon.versions.history import Series, history, promotions
from twin_daemon.versions.history_words import heading, lifetime
from twin_daemon.versions.trend import Sample, fit_trend, leaving

START = datetime(2026, 1, 1, tzinfo=UTC)


class Weeks:
    """A hand that is looked at once a week."""

    def __init__(self, root: Path, mjcf: str) -> None:
        self.day = 0.0
        self.store = VersionStore("hand", root=root, shipped=root / "none", now=lambda: START + timedelta(self.day))
        self._mjcf = mjcf

    def look(self, damping: float, half: float = 0.01, *, play: float | None = None) -> str:
        effects = [] if play is None else [{"effect": "backlash", "target": "FFJ3", "values": {"gap": play}}]
        record = ParameterRecord(
            value=damping, unit="N m s/rad", lower=0.0, upper=1.0, ci95=(damping - half, damping + half)
        )
        draft = Draft(
            hand="hand",
            kind="calibrated",
            terms={"parameters": {"FFJ3.damping": damping, "FFJ3.kp": 2.0}, "effects": effects},
            parameters={"FFJ3.damping": record},
            title=f"day {self.day:g}",
        )
        version = self.store.promote(self.store.add(draft, self._mjcf).id).id
        self.day += 7.0
        return version


@pytest.fixture
def weeks(tmp_path: Path, mjcf: str) -> Weeks:
    return Weeks(tmp_path / "hand", mjcf)


def series(weeks: Weeks, name: str) -> Series:
    (found,) = history(weeks.store, [name])
    return found


def test_wear_is_a_trend_with_the_day_it_leaves_its_band(weeks: Weeks) -> None:
    for week in range(6):
        weeks.look(0.2 + 0.07 * week)
    damping = series(weeks, "FFJ3.damping")
    assert damping.unit == "N m s/rad"
    assert damping.trend.verdict == "rising"
    assert damping.trend.slope_per_day == pytest.approx(0.01)
    left = damping.leaves_band
    assert left is not None
    assert (left.bound, left.value) == ("upper", 1.0)
    assert left.at is not None
    assert abs(left.at - (START + timedelta(days=80))) < timedelta(seconds=1)
    assert left.earliest is not None
    assert left.latest is not None
    assert left.earliest < left.at < left.latest


def test_a_hand_that_stays_as_it_is_has_no_trend(weeks: Weeks) -> None:
    for value in (0.3, 0.305, 0.298, 0.302, 0.301):
        weeks.look(value)
    damping = series(weeks, "FFJ3.damping")
    assert damping.trend.verdict == "no_trend"
    assert damping.trend.slope_ci95 is not None
    assert damping.trend.slope_ci95[0] < 0 < damping.trend.slope_ci95[1]
    assert damping.leaves_band is None
    assert series(weeks, "FFJ3.kp").trend.verdict == "too_few", "it was set once and never fitted"


def test_what_was_rolled_back_does_not_count(weeks: Weeks) -> None:
    first = weeks.look(0.2)
    weeks.look(0.9)
    weeks.store.rollback()
    last = weeks.look(0.21)
    weeks.store.promote(first)
    assert [p.version.id for p in promotions(weeks.store)] == [first, last], "an old version again is no new look"


def test_an_effect_appears_in_the_history(weeks: Weeks) -> None:
    weeks.look(0.2)
    for play in (0.01, 0.02, 0.03):
        weeks.look(0.2, play=play)
    gap = series(weeks, "backlash:FFJ3.gap")
    assert [point.value for point in gap.points] == [0.01, 0.02, 0.03]
    assert gap.points[0].at == START + timedelta(days=7)
    assert gap.unit == "rad"
    assert gap.trend.verdict == "rising"
    assert gap.leaves_band is not None, "the library of effects knows its bounds"
    assert lifetime(gap, promotions(weeks.store)) == "appeared 2026-01-08"
    assert "leaves its band at 1 about" in heading(gap)


def test_a_clock_that_was_set_back_does_not_turn_time_around(weeks: Weeks) -> None:
    for week in range(4):
        weeks.look(0.2 + 0.07 * week)
        if week == 1:
            weeks.day -= 8.0
    times = [promotion.at for promotion in promotions(weeks.store)]
    assert times == sorted(times)
    assert [point.value for point in series(weeks, "FFJ3.damping").points] == pytest.approx([0.2, 0.27, 0.34, 0.41])


def test_what_is_not_there_is_said(weeks: Weeks) -> None:
    with pytest.raises(BadInput, match="ever promoted"):
        history(weeks.store)
    weeks.look(0.2)
    with pytest.raises(BadInput, match=r"FFJ3\.damping"):
        history(weeks.store, ["FFJ3.dampling"])
    assert {one.name for one in history(weeks.store, ["FFJ3"])} == {"FFJ3.damping", "FFJ3.kp"}


def test_figures_show_every_value(weeks: Weeks, draft: Callable[..., Draft], mjcf: str) -> None:
    before = weeks.look(0.2)
    after = weeks.look(0.5, play=0.01)
    figure = history_figure("hand", history(weeks.store))
    drawn = [value for trace in figure.data for value in trace.y]
    assert {0.2, 0.5, 0.01, 2.0} <= set(drawn)
    compared = difference_figure(diff(weeks.store.get(before), weeks.store.get(after)), "old", "new")
    assert {value for trace in compared.data for value in trace.x} == {0.2, 0.5, None, 0.01}
    assert compared.data[0].error_x.array[0] == pytest.approx(0.01)
    same = weeks.store.get(before)
    assert difference_figure(diff(same, same), "old", "old").layout.annotations[0].text == "nothing differs"


def samples(days: Sequence[float], values: Sequence[float], half: float | None) -> list[Sample]:
    return [
        Sample(day, value, None if half is None else (value - half, value + half))
        for day, value in zip(days, values, strict=True)
    ]


@pytest.mark.parametrize("half", [0.196, 0.02, None], ids=["right", "too small", "none"])
def test_the_slopes_interval_holds_the_truth_as_often_as_it_says(half: float | None, rng: np.random.Generator) -> None:
    days, trials = np.arange(8.0), 200
    held = 0
    for _ in range(trials):
        trend = fit_trend(samples(days, 1.0 + 0.05 * days + rng.normal(0.0, 0.1, days.size), half))
        assert trend.slope_ci95 is not None
        held += trend.slope_ci95[0] <= 0.05 <= trend.slope_ci95[1]
    assert 0.92 <= held / trials <= 0.995


def test_two_values_need_intervals_and_two_days() -> None:
    assert fit_trend(samples([0, 1], [1.0, 2.0], None)).verdict == "too_few"
    assert fit_trend(samples([1, 1], [1.0, 2.0], 0.1)).verdict == "too_few"
    assert fit_trend(samples([0, 1], [1.0, 2.0], 0.1)).verdict == "rising"
    assert fit_trend(samples([0, 1], [1.0, 2.0], 5.0)).verdict == "no_trend"
    assert fit_trend(samples([0, 1, 2], [1.0, 1.0, 1.0], 0.0)).verdict == "no_trend"


def test_what_is_outside_already_leaves_today_and_an_open_band_never() -> None:
    falling = fit_trend(samples([0, 1, 2], [3.0, 2.0, 1.0], 0.1))
    left = leaving(falling, (2.5, 4.0), today=2.0)
    assert left is not None
    assert (left.bound, left.day, left.earliest_day, left.latest_day) == ("lower", 2.0, 2.0, 2.0)
    assert leaving(falling, (None, 4.0), today=2.0) is None


def _looks(weeks: int, rng: np.random.Generator, *, year: float = 0.0, step: float = 0.0, at: int = 0) -> np.ndarray:
    """Values (weeks,) of a quantity that is 1 at first, grows by so much a year and steps at a week."""
    week = np.arange(weeks)
    return (1.0 + year * week / 52.18 + step * (week >= at)) * (1.0 + rng.normal(0.0, 0.02, weeks))


def test_planted_yearly_rates_lie_inside_their_bands(rng: np.random.Generator) -> None:
    trials, held = 100, 0
    for trial in range(trials):
        year, step = rng.normal(0.0, 0.3), rng.choice([-0.3, 0.0, 0.3])
        values = _looks(20 + trial % 3 * 4, rng, year=year, step=step, at=int(rng.integers(4, 16)))
        trend = fit_trend(samples((7.0 * np.arange(len(values))).tolist(), values.tolist(), 0.02))
        assert trend.slope_ci95 is not None
        held += trend.slope_ci95[0] <= year / 365.25 <= trend.slope_ci95[1]
    assert 0.90 <= held / trials <= 1.0


def test_a_repair_is_a_jump_back_in_its_week_and_the_growth_goes_on(weeks: Weeks, rng: np.random.Generator) -> None:
    for week in range(16):
        worn = week if week < 10 else week - 10
        weeks.look(0.2 * (1.0 + 0.06 * worn) * (1.0 + rng.normal(0.0, 0.01)), 0.008)
    damping = series(weeks, "FFJ3.damping")
    (step,) = damping.steps
    assert step.is_repair
    assert step.until == START + timedelta(days=70)
    assert step.ci95[0] < -0.2 * 0.6 < step.ci95[1]
    assert damping.trend.verdict == "rising"
    assert damping.trend.slope_per_day == pytest.approx(0.2 * 0.06 / 7.0, rel=0.25)
    assert "a repair by" in heading(damping)


def _temperature(week: np.ndarray) -> np.ndarray:
    """Degrees, by week."""
    return 20.0 + 6.0 * np.sin(0.7 * week) + 2.0 * np.cos(2.1 * week)


def test_a_cold_morning_is_no_wear_with_the_temperature_and_ambiguous_without(rng: np.random.Generator) -> None:
    week = np.arange(16.0)
    for growth in (0.0, 0.02):
        values = (1.0 + growth * week) * (1.0 - 0.015 * (_temperature(week) - 20.0)) * (1.0 + rng.normal(0, 0.005, 16))
        bare = samples((7.0 * week).tolist(), values.tolist(), 0.02)
        known = [Sample(s.day, s.value, s.ci95, float(t)) for s, t in zip(bare, _temperature(week), strict=True)]
        assert fit_trend(bare).wanders, "something sways it that is not in its intervals"
        trend = fit_trend(known)
        assert trend.verdict == ("rising" if growth else "no_trend")
        assert trend.covariate_effect is not None
        assert trend.covariate_effect[1][0] < -0.015 < trend.covariate_effect[1][1] + 0.005


def test_swings_of_temperature_are_hardly_ever_wear_where_the_temperature_is_known() -> None:
    wear = 0
    for seed in range(25):
        rng = np.random.default_rng(seed)
        week = np.arange(16.0)
        degrees = 20.0 + 6.0 * np.sin(rng.uniform(0.3, 0.8) * week + rng.uniform(0.0, 6.0))
        values = (1.0 - 0.016 * (degrees - 20.0)) * (1.0 + rng.normal(0.0, 0.01, 16))
        looks = samples((7.0 * week).tolist(), values.tolist(), 0.02)
        known = [Sample(s.day, s.value, s.ci95, float(t)) for s, t in zip(looks, degrees, strict=True)]
        wear += fit_trend(known, among=20).verdict != "no_trend"
    assert wear == 0


def test_among_many_values_a_trend_has_to_be_surer(rng: np.random.Generator) -> None:
    values = 1.0 + 0.015 * np.arange(10.0) + 0.02 * np.array([1, -1, -1, 1, 0, 1, -1, 1, -1, 0])
    looks = samples((7.0 * np.arange(10.0)).tolist(), values.tolist(), 0.04)
    alone, among = fit_trend(looks), fit_trend(looks, among=2000)
    assert (alone.verdict, among.verdict) == ("rising", "no_trend")
    assert alone.slope_ci95 == among.slope_ci95


def test_the_covariate_comes_from_a_file_and_the_limit_from_the_description(
    tmp_path: Path, mjcf: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("TWIN_STATE_DIR", str(tmp_path))
    (tmp_path / "hand.xml").write_text(mjcf)
    named = load_hand(model=tmp_path / "hand.xml").description
    joint = next(iter(named.joints))
    (tmp_path / "hand.yaml").write_text(
        json.dumps(
            {
                "schema": 1,
                "name": "warm",
                "model": "hand.xml",
                "namespace": "warm",
                "joints": {name: {"joint": info.joint} for name, info in named.joints.items()},
                "limits": {f"{joint}.damping": {"upper": 3.0}},
            }
        )
    )
    store = VersionStore("warm", now=lambda: START + timedelta(days=float(day)))
    lines = ["time,temperature"]
    for week in range(12):
        day, warm = 7 * week, 20.0 + 5.0 * np.sin(1.3 * week)
        lines.append(f"{(START + timedelta(days=day)).isoformat()},{warm}")
        value = (0.2 + 0.01 * week) * (1.0 - 0.02 * (warm - 20.0))
        record = ParameterRecord(value=value, unit="N m s/rad", ci95=(value - 0.004, value + 0.004))
        draft = Draft(
            hand="warm", kind="calibrated", terms={}, parameters={f"{joint}.damping": record}, title=f"{week}"
        )
        store.promote(store.add(draft, mjcf).id)
    (tmp_path / "warm.csv").write_text("\n".join(lines))

    def asked(*more: str) -> dict[str, Any]:
        out = tmp_path / "out.json"
        assert main(["versions", "history", "--hand", str(tmp_path / "hand.yaml"), *more, "--json", str(out)]) == 0
        return json.loads(out.read_text())["parameters"][f"{joint}.damping"]

    assert asked()["trend"]["wanders"]
    found = asked("--covariate", str(tmp_path / "warm.csv"))
    assert found["trend"]["verdict"] == "rising"
    assert found["trend"]["covariate_effect"][0] < 0.0
    assert found["band"] == [None, 3.0]
    left = found["leaves_band"]
    assert left["earliest"] < left["at"] < left["latest"]
    assert left["at"].startswith("203")
    (tmp_path / "short.csv").write_text("\n".join(lines[:4]))
    assert (
        main(["versions", "history", "--hand", str(tmp_path / "hand.yaml"), "--covariate", str(tmp_path / "short.csv")])
        == 3
    )
    assert "says nothing of" in capsys.readouterr().err
