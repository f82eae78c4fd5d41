"""A law that nobody wrote, from the page: unexplained, proposed, added."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.proposals.conftest import arm, bags
from tests.web.browser import Browser
from tests.web.visit import mark

__all__ = ["arm", "bags"]

_WAIT_S, _WORK_S = 60.0, 600.0


@pytest.mark.slow
def test_what_is_unexplained_is_proposed_and_added_from_the_page(
    workbench: Any, browser: Browser, arm: Path, bags: Callable[..., tuple[Path, Path]]
) -> None:
    fit, held = bags("eccentric_sensor", 8.0, 6.0)
    served = workbench("--model", str(arm), "--recording", str(fit), str(held))
    known = {one["name"]: one["id"] for one in served.ask("/api/recordings")[1]["recordings"]}
    address, _, token = served.page.partition("#")
    tab = browser.open(served.page)
    tab.until(mark("ready"), _WAIT_S)
    tab.go(f"{address}?again#{token}&s={known[fit.name]}&h={known[held.name]}&step=diagnose")
    tab.until(mark("judged"), _WAIT_S)
    tab.press("#diagnose", _WAIT_S)
    tab.until(f"{mark('job')} === 'diagnose done'", _WORK_S)
    assert served.ask("/api/job?kind=diagnose")[1]["result"]["verdict"] == "unexplained"
    tab.press("#propose", _WAIT_S)
    tab.until(f"{mark('job')} === 'propose done'", _WORK_S)
    (proposal,) = served.ask("/api/job?kind=propose")[1]["result"]["proposals"]
    assert (proposal["port"], proposal["variables"], proposal["joints"]) == ("reading", ["position"], ["elbow"])
    text = "document.getElementById('proposals').innerText"
    tab.until(f"{text}.includes({proposal['formula']!r})", _WAIT_S)
    if pictures := os.environ.get("TWIN_PICTURES"):
        tab.picture(Path(pictures) / "proposed.png")
    tab.press(f"[data-add='{proposal['name']}']", _WAIT_S)
    added = tab.until(mark("added"), _WORK_S)
    result = served.ask("/api/job?kind=add")[1]["result"]
    assert result["version"] == added
    assert result["holdout_joints_after"]["mse_rad2"] < 0.2 * result["holdout_joints_before"]["mse_rad2"]
    assert tab.console == []
