"""Several hands, one router, one workbench: each hand is found, is shown by itself, and goes without the others."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from bridges.zenoh.client import ask
from bridges.zenoh.fleet import look
from bridges.zenoh.session import open_client, session_config
from tests.processes.conftest import Twin, until
from tests.web.browser import Browser
from twin_daemon.cli.children import free_port

ELBOW = """<mujoco><worldbody><body><joint name="elbow" range="-1 1"/><geom size=".1"/></body></worldbody>
<actuator><position name="elbow" joint="elbow" kp="1" ctrlrange="-1 1"/></actuator></mujoco>"""


@pytest.fixture
def other() -> str:
    """Where a daemon listens by itself; the router connects to it."""
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def session(processes: Twin, other: str) -> Iterator[zenoh.Session]:
    """A client of the router."""
    with zenoh.open(session_config("router", listen=[processes.endpoint], connect=[other])):
        client = open_client(processes.endpoint, 10.0)
        assert client is not None
        with client:
            yield client


def fleet(processes: Twin) -> dict[str, Any]:
    code, out, err = processes.run("fleet", "--seconds", "10", "--json", "-")
    assert code == 0, err
    answer = json.loads(out)
    assert answer["schema"] == 1
    return answer["hands"]


@pytest.mark.slow
def test_hands_of_one_router_are_listed_shown_and_stopped_each_by_itself(
    processes: Twin, session: zenoh.Session, other: str, workbench: Any, tmp_path: Path
) -> None:
    (tmp_path / "arm.xml").write_text(ELBOW)
    daemons = {name: processes.start("run", "--namespace", name) for name in ("left", "right")}
    arm = processes.start("run", "--model", "arm.xml", "--namespace", "lab/arm", "--endpoint", other)
    processes.start("hand", "--namespace", "left", "--trajectory", "none")
    processes.start("hand", "--namespace", "right")
    served = workbench("--fleet")
    wanted = {"lab/arm": "waiting", "left": "no_commands", "right": "following"}
    until(lambda: states(session) == wanted, 30.0)

    listed = fleet(processes)
    assert list(listed) == ["lab/arm", "left", "right"]
    assert [one["hand"] for one in listed.values()] == ["arm", "shadow_hand", "shadow_hand"]
    assert listed["lab/arm"]["age_s"] is None
    assert listed["right"]["worst_rmse_rad"] > listed["left"]["worst_rmse_rad"] >= 0.0
    left, right = (ask(session, f"twin/{name}/health") for name in ("left", "right"))
    assert left["joint_commands"]["received"] == 0 < right["joint_commands"]["received"]
    for health in (left, right):  # a second stream in between would come back in time
        assert health["joint_states"]["counts"] == {}
        assert health["joint_states"]["received"] > 0

    # what the workbench has not seen yet, too, is answered with its first hand
    until(lambda: '"scene":false' in served.ask("/?hand=lab%2Farm")[1].replace(" ", ""), 10.0)
    assert served.ask("/?hand=nobody")[1] == served.ask("/")[1]
    with pytest.raises(InvalidStatus, match="403"):
        connect(f"ws://{served.host}/live?hand=nobody")
    spans = {name: span(served.host, name) for name in ("left", "right")}
    assert spans["right"] > 10.0 * spans["left"]
    status, answer = served.ask("/api/stop", {"reason": "which?"}, token=False)
    assert (status, "NOT stopped" in answer["error"]) == (503, True)
    assert served.ask("/api/stop", {"hand": "right"}, token=False)[1]["accepted"]
    assert [ask(session, f"twin/{name}/health")["gate"] for name in ("left", "right")] == ["read_only", "stopped"]

    daemons["left"].kill()
    arm.send_signal(signal.SIGSTOP)
    left_over = {"lab/arm": "silent", "right": "following"}
    until(lambda: states(session) == left_over)
    with connect(f"ws://{served.host}/live?hand=right", max_size=None) as stream:
        lamps = left_over | {"left": "away"}
        deadline_s = time.monotonic() + 60.0
        while lamps_of(json.loads(stream.recv(timeout=20))) != lamps:  # without a pause: it would fall behind
            assert time.monotonic() < deadline_s
    arm.send_signal(signal.SIGCONT)
    until(lambda: states(session) == {"lab/arm": "waiting", "right": "following"})
    for process in (arm, daemons["right"]):
        assert processes.end(process)[0] == 0


def test_with_no_hand_there_it_says_so(processes: Twin, session: zenoh.Session) -> None:
    code, out, err = processes.run("fleet", "--seconds", "0.5")
    assert (code, out) == (5, "")
    assert "no hand is there" in err
    assert len(err.strip().splitlines()) == 1


def states(session: zenoh.Session) -> dict[str, str]:
    return {name: one.status for name, one in look(session).items()}


def lamps_of(frame: dict[str, Any]) -> dict[str, str]:
    return {one["namespace"]: one["status"] for one in frame.get("fleet", ())}


def span(host: str, namespace: str) -> float:
    """How far the joint of the largest motion has moved within the samples of the first frames, rad."""
    seen: list[list[float]] = []
    with connect(f"ws://{host}/live?hand={namespace}", max_size=None) as stream:
        while len(seen) < 20:
            seen += zip(*json.loads(stream.recv(timeout=20)).get("measured", ()), strict=True)
    return max(max(column) - min(column) for column in zip(*seen, strict=True))


@pytest.mark.slow
def test_the_page_leads_from_hand_to_hand(
    processes: Twin, session: zenoh.Session, workbench: Any, browser: Browser
) -> None:
    served = workbench("--fleet")
    tab = browser.open(served.page)
    tab.until("document.getElementById('hands').innerText.includes('No hand')")
    for name in ("left", "right"):
        processes.start("run", "--namespace", name)
        processes.start("hand", "--namespace", name)
    tab.until("location.search === '?hand=left' || location.search === '?hand=right'", 40.0)
    items = "[...document.querySelectorAll('#hands li')].map((one) => one.innerText)"
    tab.until(
        f"{items}.length === 2 && {items}.every((one) => one.startsWith('following') && one.includes('mrad'))", 40.0
    )
    tab.click("#hands a[href$='right']")
    tab.until(
        "document.querySelector('h1').innerText.startsWith('right')"
        " && document.getElementById('presence').innerText === 'following'"
    )
    assert tab.run("document.querySelector('#hands [aria-current]').innerText") == "right"
    assert tab.run("document.getElementById('keep').disabled") is False, "the token stays over the change"
    tab.click("#stop")
    # the stand-in goes on with its own motion, which no gate can end: the page says so where it is moving just then
    tab.until("/^(Stopped|THE HAND STILL MOVES)/.test(document.getElementById('said').innerText)")
    assert [ask(session, f"twin/{name}/health")["gate"] for name in ("left", "right")] == ["read_only", "stopped"]
    assert tab.console == []
