"""A bag is dropped on the page and seen: in Chromium, by keyboard, and by what assistive programs are told."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import pytest

from tests.simulation.made import worn_finger
from tests.web.browser import Browser
from tests.web.tab import Tab
from tests.web.test_browser import mark, show, shown
from twin_daemon.hand import load_hand
from twin_daemon.simulation.twin import TwinModel

AXE = Path(__file__).resolve().parents[2] / "page" / "node_modules" / "axe-core" / "axe.min.js"
RULES = "{ runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa'] }"


def drop(tab: Tab, name: str, content: bytes) -> None:
    """Lets a file fall on the page, as a browser does."""
    text = json.dumps(base64.b64encode(content).decode())
    tab.run(
        f"(() => {{ const bytes = Uint8Array.from(atob({text}), (one) => one.charCodeAt(0));"
        f" const held = new DataTransfer(); held.items.add(new File([bytes], {json.dumps(name)}));"
        " dispatchEvent(new DragEvent('drop', { dataTransfer: held, cancelable: true })); })()"
    )


def test_a_bag_that_is_dropped_is_open_with_its_worst_joint(workbench: Any, browser: Browser, tmp_path: Path) -> None:
    content = worn_finger(TwinModel.load(load_hand()), tmp_path / "worn.mcap").read_bytes()
    (tmp_path / "offered").mkdir()
    served = workbench("--folder", str(tmp_path / "offered"))
    viewer = browser.open(served.address + "/")
    viewer.until(mark("ready"), 60.0)
    drop(viewer, "worn.mcap", content)
    viewer.until(f"{shown('said')}.includes('needs the address with the token')")
    tab = browser.open(served.page)
    tab.until(mark("ready"), 60.0)
    drop(tab, "broken.mcap", content[:3000])
    tab.until(f"{shown('said')}.includes('broken.mcap')", 60.0)
    drop(tab, "worn.mcap", content)
    tab.until(f"{shown('said')}.includes('worn.mcap was read')", 60.0)
    tab.until(mark("judged"), 60.0)
    assert tab.run("document.querySelector('.chart').dataset.joint") == "rh_FFJ3"
    assert [one.name for one in (tmp_path / "offered").iterdir() if one.is_file()] == ["worn.mcap"]
    assert all("400" in line for line in tab.console), tab.console  # the refused one
    assert viewer.console == []


@pytest.mark.slow
def test_the_keyboard_alone_reaches_joints_panels_steps_and_moments(
    workbench: Any, browser: Browser, tmp_path: Path
) -> None:
    bag = worn_finger(TwinModel.load(load_hand()), tmp_path / "worn.mcap")
    tab = browser.open(workbench("--recording", str(bag)).page)
    tab.until(mark("ready"), 60.0)

    def command(words: str) -> None:
        tab.key("?")
        tab.until("document.getElementById('palette').open")
        tab.write(words)
        tab.until("document.querySelectorAll('#palette-list li').length > 0")
        tab.key("Enter")
        tab.until("!document.getElementById('palette').open")

    command("open worn")
    tab.until(mark("judged"), 60.0)
    command("select ffj2")
    tab.until("document.querySelector('.chart').dataset.joint === 'rh_FFJ2'")
    tab.key("3")
    tab.until("document.querySelector('[data-step=compare]').getAttribute('aria-current') === 'step'")
    command("show history")
    tab.until("document.getElementById('versions').checkVisibility()")
    command("colours: light")
    tab.until(f"{mark('theme')} === 'light'")
    tab.run("document.getElementById('timeline-canvas').focus()")
    tab.key("End")
    tab.until("document.getElementById('time').innerText.startsWith('5.50 /')")
    tab.until("location.hash.includes('t=5.5')")
    tab.reload()
    tab.until(mark("judged"), 60.0)
    assert tab.run("document.querySelector('.chart').dataset.joint") == "rh_FFJ2", "the address keeps the selection"
    assert tab.run("document.getElementById('time').innerText").startswith("5.50 /")
    assert tab.console == []


@pytest.mark.slow
def test_nothing_of_the_page_breaks_a_rule_of_accessibility(workbench: Any, browser: Browser, tmp_path: Path) -> None:
    if not AXE.exists():
        pytest.skip("axe-core is not here: cd page && npm ci")
    bag = worn_finger(TwinModel.load(load_hand()), tmp_path / "worn.mcap")
    tab = browser.open(workbench("--recording", str(bag)).page)
    tab.until(mark("ready"), 60.0)
    tab.run(AXE.read_text(encoding="utf-8") + "; true")

    def broken() -> list[str]:
        where = "one.nodes.slice(0, 3).map((node) => node.target.join(' ')).join(', ')"
        named = f"found.violations.map((one) => `${{one.id}}: ${{{where}}}`)"
        return list(tab.run(f"axe.run(document, {RULES}).then((found) => {named})"))

    for theme in ("dark", "light"):
        tab.colours(theme)
        tab.until(f"{mark('theme')} === {json.dumps(theme)}")
        assert broken() == [], theme
        if theme == "dark":
            tab.press("[data-source]:not([data-source=live])", held_s=1.5)  # the list is drawn anew every second
            tab.until(mark("judged"), 60.0)
        for panel in ("tables", "effects"):
            show(tab, panel)
        assert broken() == [], theme
        for panel in ("history", "events", "strips"):
            show(tab, panel)
        tab.key("4")
        assert broken() == [], theme
    assert tab.console == []
