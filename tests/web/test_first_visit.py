"""From an empty state folder to a version in use: by pointer, by keyboard, on a phone, in both browsers."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.web.browser import Browser
from tests.web.conftest import Workbench
from tests.web.firefox import Firefox, firefox
from tests.web.visit import AXE, JOINT, PLAY_RAD, Found, Visit, broken_rules, loose_finger, mark
from twin_daemon.versions import VersionStore

MOST_CLICKS = 6


@pytest.fixture
def fox(tmp_path: Path) -> Iterator[Firefox]:
    program = firefox()
    if program is None:
        pytest.skip("no Firefox on this machine (Debian: apt install firefox-esr)")
    with Firefox(program, tmp_path / "firefox") as running:
        yield running


def visited(served: Workbench, tab: Any, name: str, way: Callable[[Visit, str, Path], Found], folder: Path) -> Found:
    """A visit that came from an empty state folder to a version in use, and how it got there."""
    pictures = os.environ.get("TWIN_PICTURES")

    def picture(moment: str) -> None:
        if pictures:
            tab.picture(Path(pictures) / f"visit-{name}-{moment}.png")

    visit = Visit(tab, served.ask, picture, rules=AXE.exists())
    found = way(visit, served.page, loose_finger(folder / "loose_finger.mcap"))
    assert (found.effect, found.place) == ("backlash", JOINT)
    assert found.gap_rad == pytest.approx(PLAY_RAD, rel=0.05)
    assert found.gap_ci95_rad[0] <= PLAY_RAD <= found.gap_ci95_rad[1]
    assert found.left < 0.1, "rms on held-out motion, of what it was"
    assert VersionStore("shadow_hand").resolve("current").id == found.version
    assert found.axe == []
    assert found.violations == []
    assert found.console == []
    assert found.too_wide == []
    return found


@pytest.mark.slow
def test_a_bag_is_dropped_and_six_clicks_later_its_play_is_in_use(
    workbench: Any, browser: Browser, tmp_path: Path
) -> None:
    found = visited(workbench(), browser.open("about:blank"), "pointer", Visit.by_pointer, tmp_path)
    assert found.clicks <= MOST_CLICKS
    assert found.beside_s < 120.0, "fifteen on a machine of its own"


@pytest.mark.slow
def test_the_keyboard_alone_gets_there(workbench: Any, browser: Browser, tmp_path: Path) -> None:
    found = visited(workbench(), browser.open("about:blank"), "keyboard", Visit.by_keyboard, tmp_path)
    assert found.clicks == 0


@pytest.mark.slow
def test_a_phone_gets_there(workbench: Any, browser: Browser, tmp_path: Path) -> None:
    found = visited(workbench(), browser.open("about:blank"), "phone", Visit.on_a_phone, tmp_path)
    assert found.clicks <= MOST_CLICKS


@pytest.mark.slow
def test_firefox_gets_there(workbench: Any, fox: Firefox, tmp_path: Path) -> None:
    found = visited(workbench(), fox.open("about:blank"), "firefox", Visit.by_pointer, tmp_path)
    assert found.clicks <= MOST_CLICKS


@pytest.mark.slow
def test_firefox_shows_a_recording_as_chromium_does(workbench: Any, fox: Firefox, tmp_path: Path) -> None:
    bag = loose_finger(tmp_path / "loose_finger.mcap")
    tab = fox.open(workbench("--recording", str(bag)).page)
    tab.until(mark("ready"), 60.0)
    tab.press("[data-source]:not([data-source=live])", held_s=1.5)  # the list is drawn anew every second
    tab.until(mark("judged"), 60.0)
    tab.until(f"document.querySelector('.chart').dataset.joint === '{JOINT}'")
    tab.until("document.querySelectorAll('.chart canvas').length === 2")
    tab.until("document.querySelectorAll('.dependence .points').length === 8", 60.0)
    if AXE.exists():
        assert broken_rules(tab) == []
    assert tab.console == []
