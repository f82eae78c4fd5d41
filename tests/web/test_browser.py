"""The page in a real browser: from the live hand to a promoted effect, and names that are not to be trusted."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from tests.processes.conftest import Twin
from tests.simulation.made import worn_finger
from tests.web.browser import Browser, Tab
from twin_daemon.hand import load_hand
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import Draft, VersionStore
from twin_daemon.web.authorization import looking_token

NASTY = "<img src=x onerror=document.title='run'>"


@pytest.fixture(scope="session")
def worn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return worn_finger(TwinModel.load(load_hand()), tmp_path_factory.mktemp("bags") / "worn finger.mcap")


def choose(tab: Tab, select: str, text: str) -> None:
    """Chooses the option whose text begins so, as soon as it is there."""
    option = f"[...document.getElementById('{select}').options].find((one) => one.text.startsWith({json.dumps(text)}))"
    tab.until(f"Boolean({option})")
    tab.run(
        f"(() => {{ const select = document.getElementById('{select}'); select.value = {option}.value;"
        " select.dispatchEvent(new Event('change')); })()"
    )


def picture(tab: Tab, name: str) -> None:
    """Renews a picture of docs/workbench.md where TWIN_PICTURES names the folder for it."""
    if folder := os.environ.get("TWIN_PICTURES"):
        tab.picture(Path(folder) / f"workbench-{name}.png")


def mark(name: str) -> str:
    """What the page says of its own progress."""
    return f"document.documentElement.dataset.{name}"


def shown(element: str) -> str:
    return f"document.getElementById('{element}').innerText"


@pytest.mark.slow
def test_the_story(workbench: Any, processes: Twin, browser: Browser, worn: Path) -> None:
    daemon = processes.start("run")
    processes.start("hand", "--trajectory", "rich_finger")
    served = workbench("--recording", str(worn))
    viewer = browser.open(served.address + "/")
    tab = browser.open(served.page)  # in front: a page behind another is drawn once a second

    tab.until(f"{shown('presence')} === 'following'", 60.0)
    tab.until(f"Number({mark('frames')}) > 20")
    before = tab.run("document.querySelector('#strips canvas').toDataURL()")
    tab.until(f"document.querySelector('#strips canvas').toDataURL() !== {json.dumps(before)}")
    rows = "[...document.querySelectorAll('#joints tr')].map((row) => [...row.children].map((one) => one.textContent))"
    first = {row[0]: row[1] for row in tab.run(rows)}
    assert len(first) == 24
    assert not tab.run("document.getElementById('release-name').checkVisibility()")  # only after a stop
    tab.until(f"{rows}.some(([name, value]) => ({json.dumps(first)})[name] !== value)")

    tab.key("s")
    tab.until(f"{shown('space-words')}.includes('mrad')")
    picture(tab, "live")
    before = tab.run("document.getElementById('space').toDataURL()")
    tab.run("document.getElementById('space').focus()")
    tab.key("ArrowLeft")
    tab.until(f"document.getElementById('space').toDataURL() !== {json.dumps(before)}")

    tab.key("2")
    choose(tab, "recording", "worn finger.mcap")
    tab.until(mark("compared"), 60.0)
    assert "every sample" in tab.run(shown("reduced")).lower()
    tab.until(mark("judged"), 60.0)
    assert tab.run("document.querySelector('#errors th').textContent") == "rh_FFJ3"
    assert tab.run("document.querySelectorAll('#compared .js-plotly-plot').length") == 5  # 3 joints, heat map, state
    tab.run("document.getElementById('joined').focus()")
    tab.key("+")
    tab.until("document.querySelector('#joined .plot').layout.xaxis.range[0] > 1")
    tab.click("#worst button")
    tab.until(f"{shown('cursor-at')}.endsWith(' s')")

    tab.key("3")
    choose(tab, "learn-recording", "worn finger.mcap")
    tab.run("document.getElementById('learn-joints').value = 'rh_FFJ3'")
    choose(tab, "effect", "backlash")
    choose(tab, "place", "rh_FFJ3")
    tab.run("document.getElementById('effect-more').open = true")
    tab.until("Boolean(document.querySelector('#effect-figure .js-plotly-plot'))", 60.0)
    tab.run("document.getElementById('effect-more').scrollIntoView()")
    assert "without" in tab.run(shown("effect-words"))
    picture(tab, "effect")
    tab.run("document.getElementById('effect-more').open = false")
    tab.click("#diagnose")
    tab.until(f"{shown('job-lines')}.includes('nats')", 200.0)
    viewer.until(f"{mark('job')} && {mark('job')}.startsWith('diagnose')")
    tab.until(f"{mark('job')} === 'diagnose done'", 200.0)
    tab.run("document.getElementById('view-learn').scrollIntoView()")
    picture(tab, "diagnosis")
    said = tab.run(shown("diagnosis"))
    assert "Explained" in said
    assert "viscous_friction at rh_FFJ3" in said
    tab.click("#findings button")
    version = tab.until(mark("added"), 200.0)
    start, end = tab.until("document.querySelector('#added .js-plotly-plot').data[1].y")  # on held-out motion
    assert end < 0.01 * start
    added = served.ask("/api/job?kind=add")[1]["result"]
    found = added["finding"]  # taken over as the diagnosis has it, so that both say the same of it
    assert found["free_holdout_mse_before"] == added["holdout_before"]["mse_rad2"]
    assert found["free_holdout_mse_after"] == added["holdout_after"]["mse_rad2"]
    assert added["parameters"]["viscous_friction:rh_FFJ3.damping"]["ci95"] == found["parameters"]["damping"]["ci95"]
    for page in (said, tab.run(shown("added"))):
        assert "one free roll-out of the whole hand" in page
        assert "in short pieces of its part" in page
    tab.run("document.getElementById('added').scrollIntoView()")
    picture(tab, "added")
    tab.click("#added button")
    tab.until(f"{shown('said')}.includes('in use now')")

    viewer.until(f"{shown('about')}.includes('{version[:12]}')", 30.0)  # the daemon has taken it up
    tab.call("Page.reload")
    tab.until(mark("ready"))
    tab.key("4")
    tab.until(f"document.querySelector('#versions tr.current').innerText.includes('{version[:12]}')")
    assert "viscous_friction at rh_FFJ3" in tab.run("document.querySelector('#versions tr.current').innerText")
    assert viewer.run("[...document.querySelectorAll('#keep, #diagnose, #ladder, #add')].every((one) => one.disabled)")
    processes.end(daemon)
    viewer.until(f"{shown('presence')} === 'away'")
    assert "goes on by itself" in viewer.run(shown("words"))
    assert tab.console == viewer.console == []


def test_names_are_text_and_errors_are_said(
    workbench: Any, browser: Browser, worn: Path, tmp_path: Path, state_dir: Path
) -> None:
    (tmp_path / f"{NASTY}.mcap").write_bytes(worn.read_bytes())
    (tmp_path / "broken.mcap").write_bytes(worn.read_bytes()[:3000])
    hand = load_hand()
    twin = TwinModel.load(hand)
    draft = Draft(hand=hand.name, kind="calibrated", title=NASTY, terms=Terms().as_json(), note=NASTY)
    VersionStore(hand.name).add(draft, twin.mjcf(), alias="candidate")
    served = workbench("--recording", str(tmp_path / f"{NASTY}.mcap"), str(tmp_path / "broken.mcap"))
    tab = browser.open(served.page)
    tab.until(f"{shown('presence')} === 'unreachable'")
    assert "twin run" in tab.run(shown("words"))
    tab.until(mark("ready"))
    tab.key("2")
    choose(tab, "recording", NASTY)
    tab.until(f"{shown('opened')}.startsWith({json.dumps(NASTY)})", 60.0)
    tab.until(mark("judged"), 60.0)
    tab.key("4")
    tab.until(f"document.getElementById('versions').innerText.includes({json.dumps(NASTY)})")
    assert tab.run("document.images.length") == 0
    assert tab.run("document.title") != "run"

    tab.key("2")
    choose(tab, "recording", "broken.mcap")
    tab.until(f"{shown('said')}.includes('broken.mcap')")
    tab.click("#said button")
    # a refused request is in the browser's console by the browser's own doing; nothing else is
    assert all("400" in line for line in tab.console), tab.console


def test_a_page_of_another_machine_opens_with_its_address_and_not_without(workbench: Any, browser: Browser) -> None:
    served = workbench("--bind", "0.0.0.0", "--name", "127.0.0.1")
    port = served.address.rpartition(":")[2].partition("/")[0]
    address, look = f"http://127.0.0.1:{port}/", f"#look={looking_token(served.token)}"
    tab = browser.open(address)
    tab.until("document.body.innerText.includes('needs an address with a token')")
    tab.go("about:blank")
    tab.go(address + "#look=wrong")
    tab.until("document.body.innerText.includes('is not, or no longer')")
    tab.go("about:blank")
    tab.go(address + look)
    tab.until("document.getElementById('release') !== null")
    tab.until("location.hash === '' && document.getElementById('release').disabled")
    tab.go("about:blank")
    tab.go(f"{address}#token={served.token}")
    tab.until("location.hash === '' && document.getElementById('release')?.disabled === false")
