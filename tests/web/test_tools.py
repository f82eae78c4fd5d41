"""What one works with on the page, in one browser: sliders, plots, the hand in space, marks and history."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.simulation.made import worn_finger
from tests.web.browser import Browser
from tests.web.tab import Tab
from tests.web.test_browser import choose, mark, open_source, picture, show, shown
from twin_daemon.hand import load_hand
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import Draft, VersionStore


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


def put(tab: Tab, control: str, value: str) -> None:
    """Chooses a value of a control."""
    tab.run(
        f"(() => {{ const one = document.getElementById('{control}'); one.value = '{value}';"
        " one.dispatchEvent(new Event('change', { bubbles: true })); })()"
    )


def plots(tab: Tab) -> None:
    """Quantities, the spectrum, two cursors, pictures, and a prediction that is moved in time."""
    show(tab, "plots")
    put(tab, "quantity", "velocity")
    put(tab, "lowpass", "20")
    tab.until("location.hash.includes('q=velocity') && location.hash.includes('f=20')")
    put(tab, "view", "spectrum")
    tab.until(f"{mark('spectra')} === 'rh_FFJ3'", 60.0)
    tab.until("document.querySelectorAll('.chart.spectrum canvas').length === 2")
    picture(tab, "spectrum")
    put(tab, "view", "time")
    put(tab, "quantity", "position")
    put(tab, "lowpass", "")
    tab.until("document.querySelectorAll('.chart:not(.spectrum) canvas').length === 2")
    tab.run("document.getElementById('joined').focus()")
    tab.key("m")
    tab.key("+")
    tab.key("ArrowRight")
    tab.until(f"/Δ -?[0-9.]+ s .*measured Δ .* rad, residual Δ .* mrad/.test({shown('cursor-at')})")
    tab.key("0")
    tab.run(
        "(() => { window.saved = []; const made = URL.createObjectURL;"
        " URL.createObjectURL = (blob) => { blob.text().then((text) => window.saved.push(text)); return made(blob); };"
        " [...document.querySelectorAll('.tools button')].find((one) => one.textContent === 'SVG').click(); })()"
    )
    tab.until("window.saved.length === 1 && window.saved[0].includes('<svg')")
    sheet = ElementTree.fromstring(tab.run("window.saved[0].replace(/^[^\\n]*\\n/, '')"))
    assert len(sheet.findall(".//{http://www.w3.org/2000/svg}title")) == 4  # command, measured, predicted; residual

    before = tab.run("document.querySelector('#joint-list .right, #sidebar [data-joint] .right').textContent")
    put(tab, "plot-lag", "40")
    tab.until("location.hash.includes('lag=40')")
    late = "document.querySelector('#joint-list .right, #sidebar [data-joint] .right').textContent"
    tab.until(f"{late} !== {before!r}", 60.0)  # every error is that of the moved prediction
    tab.click("#align")
    tab.until(f"{shown('said')}.includes('every error on the page')", 60.0)
    put(tab, "plot-lag", "0")
    tab.until(f"{late} === {before!r}", 60.0)


def tick(tab: Tab, control: str) -> None:
    tab.run(f"document.getElementById('{control}').click()")


def in_space(tab: Tab) -> None:
    """Tendons, contacts and the fingertip's path beside both hands."""
    show(tab, "hand")
    tab.until(f"Number({mark('spaceFrames')}) > 0", 60.0)
    drawn = f"Number({mark('overlays')})"
    tab.until(f"{drawn} === 0", 60.0)
    tick(tab, "space-tendons")
    tab.until(f"{drawn} >= 8")  # a coupled pair in each of four fingers, measured and predicted
    tendons = tab.run(drawn)
    tick(tab, "space-path")
    tab.until(f"{drawn} === {tendons} + 2", 60.0)
    tick(tab, "space-tendons")
    tick(tab, "space-contacts")
    tab.until(f"{drawn} < {tendons} + 2", 60.0)
    assert tab.run("document.querySelector('.hand .controls').innerText").split() == [
        "tendons", "contacts", "path", "of", "the", "fingertip",
    ]  # fmt: skip


def marks_and_history(tab: Tab) -> None:
    """Reversals on the timeline; notes and names beside a version, what was done to it, and what two have in common."""
    tab.until("document.querySelectorAll('#timeline .mark.reversal').length >= 4", 60.0)
    assert "turns back at" in tab.run("document.querySelector('.mark.reversal').title")
    show(tab, "history")
    tab.click("[data-detail]:not([data-detail=nominal])")
    tab.run("document.getElementById('note-text').value = 'before the <b>repair</b>'")
    tab.click("#note-add")
    tab.until(f"{shown('about-version')}.includes('note: before the <b>repair</b>')", 60.0)
    tab.run("document.getElementById('tag-name').value = 'worn'")
    tab.click("#tag-add")
    tab.until("Boolean(document.querySelector('[data-untag=worn]'))", 60.0)
    tab.run("document.querySelectorAll('#versions input[type=checkbox]').forEach((one) => one.click())")
    tab.click("#diff")
    tab.until("document.querySelectorAll('#differences li').length > 1", 60.0)
    tab.click("[data-untag=worn]")
    tab.until("!document.querySelector('[data-untag=worn]')", 60.0)


@pytest.mark.slow
def test_the_tools_of_the_page(workbench: Any, browser: Browser, tmp_path: Path, state_dir: Path) -> None:
    hand = load_hand()
    twin = TwinModel.load(hand)
    bag = worn_finger(twin, tmp_path / "worn.mcap")
    draft = Draft(
        hand=hand.name, kind="calibrated", title="worn", terms=Terms(parameters={"rh_FFJ3.damping": 0.2}).as_json()
    )
    VersionStore(hand.name).add(draft, twin.mjcf())
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
    picture(tab, "by-hand")
    tab.click("#trial-off")
    tab.until("!document.querySelector('.chart .key').innerText.includes('by hand')")

    plots(tab)
    in_space(tab)
    marks_and_history(tab)
    assert tab.console == []
