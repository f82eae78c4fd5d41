"""Sliders, the tools of charts, notes of versions: on a phone, and as accessible as the rest, in light and dark."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.web.browser import Browser, ChromiumTab
from tests.web.test_browser import choose, mark, open_source, show
from tests.web.test_phone import WIDTH
from tests.web.visit import AXE, JOINT, broken_rules, loose_finger
from twin_daemon.hand import load_hand
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import Draft, VersionStore


def sliders(tab: ChromiumTab) -> None:
    show(tab, "effects")
    choose(tab, "effect", "backlash")
    choose(tab, "place", JOINT)
    tab.until("document.querySelectorAll('#trial input[type=range]').length === 2", 60.0)


def tools(tab: ChromiumTab) -> None:
    show(tab, "plots")
    tab.run("document.querySelector('.plots details').open = true")
    tab.until("document.getElementById('align').checkVisibility()")


def spectrum(tab: ChromiumTab) -> None:
    tab.run("document.getElementById('view').value = 'spectrum'")
    tab.run("document.getElementById('view').dispatchEvent(new Event('change', { bubbles: true }))")
    tab.until("document.querySelectorAll('.chart.spectrum canvas').length === 2", 60.0)


def notes(tab: ChromiumTab) -> None:
    show(tab, "history")
    tab.click("[data-detail]:not([data-detail=nominal])")
    tab.until("Boolean(document.getElementById('note-text'))")


def in_space(tab: ChromiumTab) -> None:
    show(tab, "hand")
    tab.until("document.getElementById('space-tendons').checkVisibility()")


def dependence(tab: ChromiumTab) -> None:
    show(tab, "dependence")
    tab.until("document.querySelectorAll('.dependence .points').length === 8", 60.0)


@pytest.mark.slow
@pytest.mark.parametrize("width", [WIDTH, 1280])
def test_the_newer_controls_fit_and_break_no_rule(
    workbench: Any, browser: Browser, tmp_path: Path, state_dir: Path, width: int
) -> None:
    if not AXE.exists():
        pytest.skip("axe-core is not here: cd page && npm ci")
    hand = load_hand()
    twin = TwinModel.load(hand)
    bag = loose_finger(tmp_path / "loose.mcap")
    draft = Draft(
        hand=hand.name, kind="calibrated", title="w", terms=Terms(parameters={"rh_FFJ3.damping": 0.2}).as_json()
    )
    VersionStore(hand.name).add(draft, twin.mjcf())
    tab = browser.open("about:blank")
    tab.screen(width, 844)
    tab.go(workbench("--recording", str(bag)).page)
    tab.until(mark("ready"), 60.0)
    if width == WIDTH:
        show(tab, "sidebar")
    open_source(tab, bag.name)
    tab.until(mark("judged"), 60.0)
    for look in (sliders, tools, spectrum, notes, in_space, dependence):
        look(tab)
        for scheme in ("dark", "light"):
            tab.colours(scheme)
            tab.until(f"{mark('theme')} === '{scheme}'")
            assert broken_rules(tab) == [], (look.__name__, scheme)
        assert tab.run("document.documentElement.scrollWidth") <= width, look.__name__
        assert tab.run(
            "[...document.querySelectorAll('.panel, aside')].every((one) => one.scrollWidth <= one.clientWidth + 1)"
        ), look.__name__
    assert tab.console == []
