"""A first visit: from a bag and an empty state folder to what is wrong, added, validated and in use.

The same way by pointer, by keyboard alone and on a phone, in either browser. What it took is counted as it goes:
clicks, seconds beside the diagnosis, and whatever axe, the console and the content security policy have to say.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tests.simulation.made import FINGER, recorded, saved
from tests.web.browser import ChromiumTab
from tests.web.tab import Tab
from twin_daemon.hand import load_hand
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

PLAY_RAD = 0.020
JOINT = "rh_FFJ3"
AXE = Path(__file__).resolve().parents[2] / "page" / "node_modules" / "axe-core" / "axe.min.js"
RULES = "{ runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa'] }"

_VIOLATIONS = (
    "window.violations = []; addEventListener('securitypolicyviolation',"
    " (event) => window.violations.push(`${event.violatedDirective} ${event.blockedURI} ${event.sourceFile}`));"
)
_WAIT_S = 120.0
_WORK_S = 900.0


def loose_finger(path: Path) -> Path:
    """A bag of one finger whose base joint has play, most of it on the joint's side."""
    play = EffectTerm(effect="backlash", target=JOINT, values={"gap": PLAY_RAD, "motor_share": 0.2})
    twin = TwinModel.load(load_hand()).changed(Terms().with_effect(play))
    return saved(recorded(twin, FINGER, np.random.default_rng(4)), path)


def broken_rules(tab: Tab) -> list[str]:
    """What of the page breaks a rule of WCAG AA that axe knows, with where."""
    if not tab.run("Boolean(window.axe)"):
        tab.run(f"(() => {{ {AXE.read_text(encoding='utf-8')}; return true; }})()")
    where = "one.nodes.slice(0, 3).map((node) => node.target.join(' ')).join(', ')"
    named = f"found.violations.map((one) => `${{one.id}}: ${{{where}}}`)"
    return list(tab.run(f"axe.run(document, {RULES}).then((found) => {named})"))


def mark(name: str) -> str:
    return f"document.documentElement.dataset.{name}"


@dataclass
class Found:
    """What a visit took, and what came of it."""

    clicks: int = 0
    keys: int = 0
    seconds: float = 0.0
    diagnosis_s: float = 0.0
    addition_s: float = 0.0
    gap_rad: float = float("nan")
    gap_ci95_rad: tuple[float, float] = (float("nan"), float("nan"))
    effect: str = ""
    place: str = ""
    left: float = float("nan")
    """rms on held-out motion after the addition, of what it was before."""
    version: str = ""
    axe: list[str] = field(default_factory=list)
    violations: list[str] = field(default_factory=list)
    console: list[str] = field(default_factory=list)
    too_wide: list[str] = field(default_factory=list)

    @property
    def beside_s(self) -> float:
        """Seconds beside the diagnosis itself."""
        return self.seconds - self.diagnosis_s


class Visit:
    """One visitor. `picture(name)` is called at the moments that are worth one."""

    def __init__(self, tab: Tab, ask: Callable[[str], Any], picture: Callable[[str], None], *, rules: bool) -> None:
        self._tab, self._ask, self._picture = tab, ask, picture
        self._rules = rules
        self.found = Found()
        self._begun_s = 0.0

    def by_pointer(self, address: str, bag: Path) -> Found:
        """Drops the bag (in Firefox, whose protocol drops no files: chooses it), and clicks."""
        self._open(address)
        if isinstance(self._tab, ChromiumTab):
            self._tab.drop(bag)
            self.found.clicks += 1
        else:
            self._press("#drop")
            self._tab.choose_file(bag)
        self._opened()
        self._press("#diagnose")
        self._diagnosed()
        self._press("[data-add]")
        self._added()
        self._press("#inspector .next")  # to Validate
        self._validated()
        self._press("#inspector [data-promote]")
        self._press("#reason-yes")
        return self._promoted()

    def by_keyboard(self, address: str, bag: Path) -> Found:
        """The same without a pointer: the palette of commands names every button of the step."""
        self._open(address)
        self._command("send a recording")
        self._tab.choose_file(bag)
        self._opened()
        self._command("do: diagnose")
        self._diagnosed()
        self._command("do: add backlash")
        self._added()
        self._key("6")
        self._validated()
        self._key("7")
        self._command("do: promote")
        self._tab.until("document.activeElement?.id === 'reason'")
        self._tab.write("it follows the loose finger")
        self._key("Enter")
        return self._promoted()

    def on_a_phone(self, address: str, bag: Path) -> Found:
        """One panel at a time, 390 pixels wide."""
        self._tab.screen(390, 844)
        self._open(address)
        self._press("#choose-file")
        self._tab.choose_file(bag)
        self._opened()
        self._press("#diagnose")
        self._diagnosed()
        self._press("[data-add]")
        self._added()
        self._press("#inspector .next")
        self._validated()
        self._press("#inspector [data-promote]")
        self._press("#reason-yes")
        return self._promoted()

    # -- the moments ---------------------------------------------------------------------------------------

    def _open(self, address: str) -> None:
        self._tab.before_each_page(_VIOLATIONS)
        if isinstance(self._tab, ChromiumTab):
            self._tab.keep_choosers_closed()
        self._tab.go(address)
        self._tab.until(mark("ready"), _WAIT_S)
        self._look("empty")
        self._begun_s = time.monotonic()

    def _opened(self) -> None:
        self._tab.until(mark("judged"), _WAIT_S)
        self._look("opened")

    def _diagnosed(self) -> None:
        self._tab.until(f"{mark('job')} === 'diagnose running'", _WAIT_S)
        self._tab.until(f"{mark('job')} !== 'diagnose running'", _WORK_S)
        job = self._job("diagnose")
        assert job["status"] == "done", job
        self.found.diagnosis_s = job["seconds"]
        assert job["result"]["findings"], job["result"]
        finding = job["result"]["findings"][0]
        self.found.effect, self.found.place = finding["effect"], finding["target"]
        gap = finding["parameters"].get("gap", {"value": float("nan"), "ci95": None})
        self.found.gap_rad = gap["value"]
        self.found.gap_ci95_rad = tuple(gap["ci95"] or self.found.gap_ci95_rad)
        self._tab.until("Boolean(document.querySelector('[data-add]'))", _WAIT_S)
        self._look("verdict")

    def _added(self) -> None:
        self.found.version = self._tab.until(mark("added"), _WORK_S)
        self.found.addition_s = self._job("add")["seconds"]
        self._tab.until(
            "Boolean(document.querySelector('#inspector .next') && document.getElementById('added'))", _WAIT_S
        )
        self._look("added")

    def _validated(self) -> None:
        self._tab.until("document.getElementById('inspector').innerText.includes('Better on motion that no fit')")
        self._look("validated")

    def _promoted(self) -> Found:
        self._tab.until("document.getElementById('said').innerText.includes('in use now')", _WAIT_S)
        self.found.seconds += time.monotonic() - self._begun_s
        self._begun_s = time.monotonic()
        self._tab.until("document.getElementById('inspector').innerText.includes('is in use')", _WAIT_S)
        shown = "new URLSearchParams(location.hash.slice(1)).get('v')"  # the version that the page goes on with
        self._tab.until(f"{shown} === '{self.found.version}'", _WAIT_S)
        steps = self._job("add")["result"]
        self.found.left = (steps["holdout_after"]["mse_rad2"] / steps["holdout_before"]["mse_rad2"]) ** 0.5
        self._look("promoted")
        self.found.violations += self._tab.run("window.violations")
        self.found.console = self._tab.console
        return self.found

    # -- hands ---------------------------------------------------------------------------------------------

    def _press(self, selector: str) -> None:
        self._tab.press(selector, _WAIT_S)
        self.found.clicks += 1

    def _key(self, key: str) -> None:
        self._tab.key(key)
        self.found.keys += 1

    def _command(self, words: str) -> None:
        self._key("?")
        self._tab.until("document.getElementById('palette').open")
        self._tab.write(words)
        self.found.keys += len(words)
        self._tab.until("document.querySelectorAll('#palette-list li').length > 0")
        self._key("Enter")
        self._tab.until("!document.getElementById('palette').open")

    def _look(self, name: str) -> None:
        """A picture and a look of axe, outside the time that is counted; and nothing sticks out at the right."""
        self.found.seconds += time.monotonic() - self._begun_s if self._begun_s else 0.0
        self._picture(name)
        wide = self._tab.run("document.documentElement.scrollWidth - innerWidth")
        if wide > 0:
            self.found.too_wide.append(f"{name}: {wide} px")
        if self._rules:
            self.found.axe += [f"{name}: {one}" for one in broken_rules(self._tab)]
        self._begun_s = time.monotonic()

    def _job(self, kind: str) -> dict[str, Any]:
        return self._ask(f"/api/job?kind={kind}")[1]
