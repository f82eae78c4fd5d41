"""The page on a phone: nothing is wider than the screen, and an error is gone with the success after it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.simulation.made import worn_finger
from tests.web.browser import Browser
from tests.web.test_browser import mark, open_source, show, shown
from twin_daemon.hand import load_hand
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import Draft, VersionStore

WIDTH = 390
_WIDER = """[...document.querySelectorAll('body *')].filter((one) => {
  for (let up = one; up; up = up.parentElement) if (getComputedStyle(up).overflowX !== 'visible') return false;
  return one.getBoundingClientRect().right > 391;
}).map((one) => `${one.tagName}#${one.id}.${one.className}`)"""


def test_nothing_is_wider_than_a_phone_and_errors_go_with_success(
    workbench: Any, browser: Browser, tmp_path: Path, state_dir: Path
) -> None:
    hand = load_hand()
    twin = TwinModel.load(hand)
    bag, broken = worn_finger(twin, tmp_path / f"{'a_long_name_' * 6}.mcap"), "broken"
    (tmp_path / f"{broken}.mcap").write_bytes(bag.read_bytes()[:3000])
    title = "ladder: " + ", ".join(f"stribeck_friction at rh_{finger}J3" for finger in ("FF", "MF", "RF", "LF", "TH"))
    draft = Draft(
        hand=hand.name, kind="effect_added", title=title, terms=Terms(parameters={"rh_FFJ3.damping": 0.2}).as_json()
    )
    VersionStore(hand.name).add(draft, twin.mjcf(), alias="candidate")
    tab = browser.open("about:blank")
    tab.screen(WIDTH, 844)
    tab.go(workbench("--folder", str(tmp_path)).page)
    tab.until(mark("ready"))
    panels = tab.run("[...document.querySelectorAll('#one-panel [data-panel]')].map((one) => one.dataset.panel)")
    assert {"inspector", "sidebar", "plots", "hand", "dependence", "tables", "fall", "history", "effects"} <= set(
        panels
    )
    show(tab, "sidebar")
    open_source(tab, broken)
    tab.until(f"{shown('said')}.includes('broken.mcap')")
    open_source(tab, bag.stem)
    tab.until(mark("judged"), 60.0)
    tab.until("document.getElementById('said').hidden")  # what failed before is over
    for panel in panels:
        tab.click(f"#one-panel [data-panel='{panel}']")
        assert tab.run("document.querySelectorAll('.single > *').length") == 1, "one at a time"
        if panel == "history":
            tab.until("document.getElementById('versions').innerText.includes('stribeck')")
        assert tab.run("innerWidth") == WIDTH, (panel, tab.run(_WIDER))
        assert tab.run("document.documentElement.scrollWidth") <= WIDTH, (panel, tab.run(_WIDER))
    for step in range(7):
        tab.run(f"document.getElementById('step-small').selectedIndex = {step}")
        tab.run("document.getElementById('step-small').dispatchEvent(new Event('change'))")
        show(tab, "inspector")
        assert tab.run("document.documentElement.scrollWidth") <= WIDTH, (step, tab.run(_WIDER))
