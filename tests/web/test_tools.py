"""What one works with on the page, in one browser: sliders, plots, the hand in space, marks and history."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tests.simulation.made import worn_finger
from tests.web.browser import Browser, Tab
from tests.web.test_browser import choose, mark, open_source, show, shown
from twin_daemon.hand import load_hand
from twin_daemon.simulation.twin import TwinModel


def drag(tab: Tab, name: str, step: int) -> list[float]:
    """Moves the slider of a value; (ms until the prediction is drawn, ms of them in the server)."""
    before = (tab.run(mark("trial")) or "0 0 0").split()[2]
    tab.run(
        f"(() => {{ const one = document.getElementById('slider-{name}'); one.value = {step};"
        " one.dispatchEvent(new Event('input', { bubbles: true })); })()"
    )
    tab.until(f"{mark('trial')} && {mark('trial')}.split(' ')[2] !== '{before}'")
    return [float(figure) for figure in tab.run(mark("trial")).split()[:2]]


def by_hand(tab: Tab, drags: int) -> np.ndarray:
    """Drags the damping of the worn finger's joint; (drags, 2) ms as `drag` says."""
    show(tab, "effects")
    choose(tab, "effect", "viscous_friction")
    choose(tab, "place", "rh_FFJ3")
    tab.until("Boolean(document.getElementById('slider-damping'))", 60.0)
    drag(tab, "damping", 100)  # the first one compiles the finger
    return np.array([drag(tab, "damping", 100 + 40 * index) for index in range(drags)])


def test_the_tools_of_the_page(workbench: Any, browser: Browser, tmp_path: Path) -> None:
    bag = worn_finger(TwinModel.load(load_hand()), tmp_path / "worn.mcap")
    tab = browser.open(workbench("--recording", str(bag)).page)
    tab.until(mark("ready"), 60.0)
    open_source(tab, bag.name)
    tab.until(mark("judged"), 60.0)

    waits = by_hand(tab, 8)
    said = tab.run(shown("trial-words"))
    assert "mrad rms in the view" in said
    assert "viscous friction by hand" in tab.run("document.querySelector('.chart .key').innerText")
    assert "--set damping=" in tab.run(shown("trial-command"))
    assert np.median(waits[:, 0]) < 5000.0, waits
    tab.click("#trial-off")
    tab.until("!document.querySelector('.chart .key').innerText.includes('by hand')")
    assert tab.console == []
