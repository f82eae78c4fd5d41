"""The page in a real browser: from the live hand to a promoted effect, and names that are not to be trusted."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from tests.processes.conftest import Twin
from tests.simulation.made import worn_finger
from tests.web.browser import Browser
from tests.web.tab import Tab
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


def open_source(tab: Tab, name: str) -> None:
    """Opens a recording of the list by the beginning of its name."""
    button = (
        f"[...document.querySelectorAll('[data-source]')].find((one) => "
        f"one.querySelector('.name').textContent.startsWith({json.dumps(name)}))"
    )
    tab.until(f"Boolean({button})")
    tab.run(f"{button}.click()")


def show(tab: Tab, panel: str) -> None:
    """Brings a panel to the front."""
    tab.run(f"dispatchEvent(new CustomEvent('open-panel', {{ detail: '{panel}' }}))")


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
    tab.until(f"Number({mark('frames')}) > 20", 60.0)
    tab.until("document.querySelector('#strips canvas') !== null", 60.0)
    before = tab.run("document.querySelector('#strips canvas').toDataURL()")
    tab.until(f"document.querySelector('#strips canvas').toDataURL() !== {json.dumps(before)}")
    tab.run("document.getElementById('strips-hold').click()")
    blank = "!one.getContext('2d').getImageData(0, 0, one.width, one.height).data.some(Boolean)"
    assert not tab.run(f"[...document.querySelectorAll('#strips canvas')].some((one) => {blank})"), (
        "those out of sight show what was held, too"
    )
    tab.run("document.getElementById('strips-hold').click()")
    show(tab, "plots")
    tab.until("!document.querySelector('#strips canvas')?.checkVisibility()")
    tab.key("h")  # held while out of sight: it shows what was drawn last
    show(tab, "strips")
    tab.until("document.querySelector('#strips canvas')?.checkVisibility()")
    assert tab.run("document.querySelector('#strips canvas').width > 0")
    tab.key("h")
    rows = "[...document.querySelectorAll('#joints tr')].map((row) => [...row.children].map((one) => one.textContent))"
    first = {row[0]: row[1] for row in tab.run(rows)}
    assert len(first) == 24
    assert not tab.run("document.getElementById('release-name').checkVisibility()")  # only after a stop
    tab.until(f"{rows}.some(([name, value]) => ({json.dumps(first)})[name] !== value)")

    tab.key("s")
    tab.until(f"{shown('space-words')}.includes('mrad')")
    tab.until(f"Number({mark('spaceFrames')}) > 2", 60.0)
    picture(tab, "live")
    before = tab.until(mark("turned"))
    tab.run("document.getElementById('space').focus()")
    tab.key("ArrowLeft")
    tab.until(f"{mark('turned')} !== {json.dumps(before)}")

    open_source(tab, worn.name)
    tab.until(mark("compared"), 60.0)
    assert "every sample" in tab.run(shown("reduced")).lower()
    tab.until(mark("judged"), 60.0)
    tab.until("document.querySelector('.chart').dataset.joint === 'rh_FFJ3'")  # the worst one
    show(tab, "tables")
    assert tab.run("document.querySelector('#errors tbody th').textContent") == "FFJ3"
    assert tab.run("document.querySelectorAll('#heat .cell').length") > 10
    rmse_mrad = float(tab.run("document.querySelector('#errors tbody td').textContent"))
    for charts in (2, 3):
        tab.click("#errors input:not(:checked)")
        tab.until(f"document.querySelectorAll('.chart').length === {charts}")
    tab.until("document.querySelectorAll('.chart canvas').length === 6")  # angle and residual of each
    tab.run("document.getElementById('joined').focus()")
    tab.key("+")
    tab.until(f"Number({mark('range')}.split(' ')[0]) > 1")
    tab.click("#worst .show")
    tab.until(f"{shown('cursor-at')}.endsWith(' s')")
    show(tab, "dependence")
    tab.until("document.querySelectorAll('.dependence .points').length === 8")
    code, out, err = processes.run("compare", "--recording", str(worn), "--version", "nominal", "--json", "-")
    assert code == 0, err
    assert rmse_mrad == pytest.approx(1e3 * json.loads(out)["joints"]["rh_FFJ3"]["rmse_rad"], rel=1e-2)

    show(tab, "effects")
    choose(tab, "effect", "backlash")
    choose(tab, "place", "rh_FFJ3")
    tab.until("document.querySelectorAll('#effect-figure svg').length === 2", 60.0)
    assert tab.run("document.querySelector('#effect-picture svg').dataset.effect") == "backlash"
    assert "without" in tab.run(shown("effect-words"))
    picture(tab, "effect")
    show(tab, "fall")

    tab.key("2")
    tab.click("#check")
    tab.until(f"{mark('job')} === 'check done'", 600.0)
    tab.until(f"{shown('inspector')}.includes('are identifiable')")
    tab.key("4")
    tab.until("Boolean(document.getElementById('learn-joints'))")
    tab.run("document.getElementById('learn-joints').value = 'rh_FFJ3'")
    assert tab.run("document.querySelector('#command').textContent").startswith("twin diagnose --recording ")
    tab.click("#diagnose")
    tab.until("document.getElementById('job-lines').textContent.includes('nats')", 900.0)
    viewer.until(f"{mark('job')} && {mark('job')}.startsWith('diagnose')")
    tab.until(f"{mark('job')} === 'diagnose done'", 900.0)
    tab.until("Boolean(document.querySelector('[data-add]'))")
    assert tab.run("document.querySelectorAll('table.race tr').length") > 0, "candidates as bars"
    picture(tab, "diagnosis")
    said = tab.run("document.getElementById('diagnosis').textContent")
    assert "Explained" in said
    assert tab.run("document.querySelector('[data-add]').dataset.add") == "viscous_friction"
    assert "viscous friction at FFJ3" in said
    tab.click("[data-add]")
    version = tab.until(mark("added"), 900.0)
    assert float(tab.until(f"{mark('fallen')}", 60.0)) < 0.1, "rms on held-out motion, of what it was"
    added = served.ask("/api/job?kind=add")[1]["result"]
    found = added["finding"]  # taken over as the diagnosis has it, so that both say the same of it
    assert found["free_holdout_mse_before"] == added["holdout_before"]["mse_rad2"]
    assert found["free_holdout_mse_after"] == added["holdout_after"]["mse_rad2"]
    assert added["parameters"]["viscous_friction:rh_FFJ3.damping"]["ci95"] == found["parameters"]["damping"]["ci95"]
    for page in (said, tab.until("document.getElementById('added')?.textContent")):
        assert "one free roll-out of the whole hand" in page.lower()
        assert "in short pieces of its part" in page
    tab.until("document.querySelectorAll('.fall tr').length >= 4")
    picture(tab, "added")
    tab.key("6")
    tab.until(f"{shown('inspector')}.includes('Better on motion that no fit has seen')")
    tab.key("7")
    tab.click(f"#inspector [data-promote='{version}']")
    tab.until("Boolean(document.getElementById('reason'))")
    tab.run("document.getElementById('reason').value = 'it follows the worn finger'")
    tab.click("#reason-yes")
    tab.until(f"{shown('said')}.includes('in use now')")
    assert "it follows the worn finger" in processes.run("versions", "show", version)[1]

    viewer.until(f"{shown('about')}.includes('{version[:12]}')", 30.0)  # the daemon has taken it up
    tab.reload()
    tab.until(mark("ready"))
    show(tab, "history")  # at once: the daemon goes back by itself from what does worse on this other hand
    tab.until(f"document.querySelector('#versions tr.current').innerText.includes('{version[:12]}')")
    assert "viscous_friction at rh_FFJ3" in tab.run("document.querySelector('#versions tr.current').innerText")
    assert tab.run("document.querySelector('#versions tbody tr').dataset.version") == "nominal"
    tab.until(mark("judged"), 60.0)  # the address keeps what was open
    open_source(viewer, worn.name)
    viewer.until(mark("judged"), 60.0)
    viewer.run("document.querySelector('[data-step=diagnose]').click()")
    viewer.until("Boolean(document.getElementById('diagnose'))")
    assert viewer.run("[...document.querySelectorAll('#keep, #diagnose, #ladder, #add')].every((one) => one.disabled)")
    processes.end(daemon)
    viewer.until(f"{shown('presence')} === 'away'")
    assert "goes on by itself" in viewer.run("document.getElementById('words').textContent")
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
    assert "twin run" in tab.run("document.getElementById('words').textContent")
    tab.until(mark("ready"))
    open_source(tab, NASTY)
    tab.until(f"{shown('opened')}.startsWith({json.dumps(NASTY)})", 60.0)
    tab.until(mark("judged"), 60.0)
    show(tab, "history")
    tab.until(f"document.getElementById('versions').innerText.includes({json.dumps(NASTY)})")
    assert tab.run("document.images.length") == 0
    assert tab.run("document.title") != "run"

    open_source(tab, "broken.mcap")
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
