"""The page tells of a motion that begins by itself, counts down, and cancels it for whoever looks."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import yaml

from bridges.zenoh.client import ask
from bridges.zenoh.commander import Commander
from bridges.zenoh.session import open_client
from tests.processes.conftest import Twin, until
from tests.processes.test_automatic import ACTIVE, NS, SLOW_HAND
from tests.web.browser import Browser
from twin_daemon.hand import load_hand
from twin_daemon.security.identity import load_keyring

SHOWN = "!document.getElementById('automatic').hidden"
WORDS = "document.getElementById('automatic-words').textContent"


@pytest.mark.slow
def test_the_page_counts_down_and_its_button_cancels(
    workbench: Any, processes: Twin, browser: Browser, tmp_path: Path, state_dir: Path
) -> None:
    config = tmp_path / "twin.yaml"
    config.write_text(yaml.safe_dump({"gate": SLOW_HAND, "recalibration": ACTIVE | {"countdown_s": 20.0}}))
    processes.start("run", "-c", str(config))
    processes.start("hand", "--trajectory", "none")
    served = workbench()
    session = open_client(processes.endpoint, 60.0)
    assert session is not None
    with session:
        until(lambda: ask(session, f"twin/{NS}/state", 20.0)["fresh_joints"] == 24, 30.0)
        day = f"{datetime.now(UTC) + timedelta(days=30):%Y-%m-%d}"
        assert processes.run("consent", "give", "--name", "Ann Example", "--until", day)[0] == 0
        tab = browser.open(served.page)
        tab.until("Number(document.documentElement.dataset.frames) > 5", 60.0)
        assert not tab.run(SHOWN)
        operator = Commander(session, load_hand().description, load_keyring(state_dir / "keys.json"), "operator")
        until(lambda: (a := operator.ask("recalibrate"))["accepted"] or a["why"].endswith("announced"), 40.0)
        tab.until(SHOWN, 10.0)
        left = f"Number({WORDS}.match(/the hand moves by itself in ([0-9]+) s/)?.[1])"
        first = tab.until(left, 5.0)
        assert 0 < first <= 20
        tab.until(f"{left} < {first}", 5.0)
        tab.click("#cancel")
        tab.until(f"!({SHOWN})", 10.0)
        events = ask(session, f"twin/{NS}/events")["events"]
        texts = [event["text"] for event in events if event["kind"] == "automatic"]
        assert "the page of the workbench" in texts[-1]
        assert operator.status()["commands_sent"] == 0
