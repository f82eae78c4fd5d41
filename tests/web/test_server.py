"""The server without a browser: who may do what, what it says live, and that it says every error."""

from __future__ import annotations

import hashlib
import json
import os
import socket
import time
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from tests.processes.conftest import Twin, until
from tests.processes.manager import Manager
from tests.simulation.made import FINGER, recorded, saved
from twin_daemon.hand import load_hand
from twin_daemon.signals.trajectory import load_trajectory
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import Draft, ParameterRecord, VersionStore
from twin_daemon.web.authorization import looking_token
from twin_daemon.web.server import listen


def test_reading_is_free_and_everything_else_needs_the_token(served: Any) -> None:
    assert served.ask("/")[0] == 200
    for path in ("/api/keep", "/api/anything"):
        status, answer = served.ask(path, {}, token=False)
        assert (status, "token" in answer["error"] or "whole address" in answer["error"]) == (401, True)
        assert served.ask(path, {}, token=False, X_Twin_Token=served.token[:-1])[0] == 401
    assert served.ask("/api/keep", {})[0] == 503  # allowed, but no daemon is there
    assert served.token not in served.ask("/")[1]


def test_a_foreign_name_or_page_gets_nothing(served: Any) -> None:
    assert served.ask("/", Host="twin.lab")[0] == 401
    assert served.ask("/", Host="twin.lab", X_Twin_Token=served.token)[0] == 200
    for headers in (
        {"Host": "evil.example"},
        {"Host": f"evil.example:{served.host.rpartition(':')[2]}"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Mode": "no-cors"},
    ):
        for path, body in (("/", None), ("/api/keep", {}), ("/api/stop", {})):
            status, answer = served.ask(path, body, **headers)
            assert status == 403, headers
            assert set(answer) == {"error"}
    for origin in ("http://evil.example", "null"):
        with pytest.raises(InvalidStatus, match="403"):
            connect(f"ws://{served.host}/live", origin=origin)


def test_the_policy_forbids_foreign_code(served: Any) -> None:
    with socket.create_connection(served.host.split(":")) as raw:
        raw.sendall(f"GET / HTTP/1.0\r\nHost: {served.host}\r\n\r\n".encode())
        head = raw.makefile("rb").read().partition(b"\r\n\r\n")[0].decode().lower()
    policy = next(line for line in head.splitlines() if line.startswith("content-security-policy"))
    assert "default-src 'none'" in policy
    assert "script-src 'self';" in policy
    assert "frame-ancestors 'none'" in policy
    assert "x-content-type-options: nosniff" in head
    assert served.ask("/static/../app.py")[0] == 404
    assert served.ask("/static/%2e%2e/app.py")[0] == 404


def test_what_cannot_be_is_one_line(served: Any, processes: Twin) -> None:
    assert served.ask("/nothing")[1] == {"error": "Not Found."}
    for body in (["no object"], {"reason": "x" * 70_000}):
        status, answer = served.ask("/api/keep", body)
        assert status == 400, answer
        assert "request" in answer["error"]
    status, answer = served.ask("/api/stop", {}, token=False)
    assert status == 503
    assert "NOT stopped" in answer["error"]
    code, _, err = processes.run("workbench", "--port", served.host.rpartition(":")[2])
    assert code == 3
    assert "--port" in err


@pytest.mark.slow
def test_the_stream_tells_hand_and_twin_and_who_is_away(workbench: Any, processes: Twin) -> None:
    served = workbench()
    with connect(f"ws://{served.host}/live", max_size=None) as stream:

        def frame(wanted: Any) -> dict[str, Any]:
            """The next that is wanted; read without a pause, as a browser does, so that none of them is old."""
            deadline_s = time.monotonic() + 40.0
            while not wanted(found := json.loads(stream.recv(timeout=20))):
                assert time.monotonic() < deadline_s, found
            return found

        about = frame(lambda f: "about" in f)["about"]
        assert about["presence"] == "unreachable"
        assert "twin run" in about["words"]
        daemon = processes.start("run")
        processes.start("hand", "--trajectory", "rich_finger")
        frame(lambda f: f.get("about", {}).get("presence") == "following")
        first, second = (frame(lambda f: len(f.get("t", ())) > 0) for _ in range(2))
        assert not second["fresh"]
        assert first["t"][-1] < second["t"][0]
        assert second["t"] == sorted(second["t"])
        for part in ("measured", "predicted"):
            assert len(second[part]) == 24
            assert {len(values) for values in second[part]} == {len(second["t"])}
        known = frame(lambda f: "about" in f and f["about"]["version"])
        assert known["about"]["gate"] == "read_only"
        assert any(value > 0.0 for value in known["rms"] if value is not None)

        kept = until(lambda: (found := served.ask("/api/keep", {}))[0] == 200 and found[1]["kept"] and found[1], 40.0)
        assert kept["messages"] > 0
        status, answer = served.ask("/api/stop", {"reason": "a test"}, token=False)
        assert (status, answer["accepted"], answer["proved"]) == (200, True, True)
        assert (answer["hand_still_moves"], answer["safe"]) == (True, False)  # the hand moves by itself
        assert "STILL MOVES" in answer["words"]
        frame(lambda f: f.get("about", {}).get("gate") == "stopped")
        assert served.ask("/api/release", {"reason": "a test"}, token=False)[0] == 401
        assert "needs a reason" in served.ask("/api/release", {})[1]["why"]
        assert served.ask("/api/release", {"reason": "a test"})[1]["accepted"]
        frame(lambda f: f.get("about", {}).get("gate") == "read_only")

        processes.end(daemon)
        assert "silent" in frame(lambda f: f.get("about", {}).get("presence") == "away")["about"]["words"]
        processes.start("run")
        frame(lambda f: f.get("about", {}).get("presence") == "following")
        frame(lambda f: len(f.get("t", ())) > 0)


def test_no_file_but_those_offered_is_opened(served: Any) -> None:
    assert served.ask("/api/recordings") == (200, {"recordings": []})
    for path in ("/etc/passwd", "..%2F..%2Fetc%2Fpasswd", ""):
        status, answer = served.ask(f"/api/recording?recording={path}")
        assert status == 400
        assert "not there" in answer["error"]
    for body in ({"recording": "/etc/passwd"}, {}):
        assert served.ask("/api/job/diagnose", body)[0] == 400


def test_no_word_of_the_page_becomes_an_option(workbench: Any, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("no recording")
    served = workbench("--folder", str(tmp_path))
    (offer,) = served.ask("/api/recordings")[1]["recordings"]
    right = {"recording": offer["id"], "version": "nominal", "effect": "spring", "joint": "rh_FFJ3"}
    for wrong in ({"joint": "--json"}, {"effect": "--help"}, {"version": "--terms=/etc/passwd"}):
        status, answer = served.ask("/api/job/add", right | wrong)
        assert status == 400, wrong
        assert next(iter(wrong.values())) in answer["error"]
    for wrong in (0, "soon", 1e9, True):
        assert served.ask("/api/job/diagnose", right | {"within_s": wrong})[0] == 400, wrong
    assert served.ask("/api/job?kind=add")[1] == {"status": "none"}
    assert served.ask("/api/job/stop", {})[0] == 400
    assert served.ask("/api/job/add", right)[0] == 200
    job = until(lambda: (found := served.ask("/api/job?kind=add")[1])["status"] != "running" and found, 40.0)
    assert job["status"] == "failed"
    assert "a.csv" in job["error"]


def test_versions_are_promoted_exported_and_rolled_back(workbench: Any, state_dir: Path) -> None:
    hand = load_hand()
    twin = TwinModel.load(hand)
    store = VersionStore(hand.name)
    error = {"before": {"mse_rad2": 4e-4}, "after": {"mse_rad2": 1e-4}}
    terms = Terms(parameters={"rh_FFJ3.damping": 0.3})
    known = {"rh_FFJ3.damping": ParameterRecord(value=0.3, unit="N m s/rad", ci95=(0.2, 0.4))}
    draft = Draft(hand=hand.name, kind="calibrated", terms=terms.as_json(), errors=error, parameters=known)
    parent = store.add(draft, twin.changed(terms).mjcf())
    child = store.add(draft.model_copy(update={"parent": parent.id, "title": "again"}), twin.changed(terms).mjcf())
    served = workbench()
    rows = {row["id"]: row for row in served.ask("/api/versions")[1]["versions"]}
    assert (rows[parent.id]["depth"], rows[child.id]["depth"]) == (1, 2), "under the nominal model"
    assert served.ask("/api/versions/promote", {"version": parent.id}, token=False)[0] == 401
    assert served.ask("/api/versions/promote", {"version": "nonsense"})[0] == 400
    for one in (parent, child):
        assert served.ask("/api/versions/promote", {"version": one.id})[1]["current"] == one.id
    assert served.ask("/api/versions/rollback", {})[1]["current"] == parent.id
    assert store.aliases()["current"] == parent.id
    status, mjcf = served.ask(f"/api/versions/export?version={child.id}")
    assert (status, mjcf) == (200, store.model(child.id))
    points = served.ask("/api/versions/parameter?name=rh_FFJ3.damping")[1]["points"]
    (point,) = [one for one in points if one["version"] == parent.id]
    assert (point["value"], point["ci95"]) == (0.3, [0.2, 0.4])
    (series,) = served.ask("/api/versions/history?name=rh_FFJ3.damping")[1]["series"]
    assert [one["value"] for one in series["points"]] == [0.3], "of those that were promoted and not rolled back"
    assert series["words"] == "too few values for a trend"
    assert served.ask("/api/versions/history")[1]["series"] == [], "nothing moves yet"
    assert served.ask("/api/versions/history?name=rh_FFJ9.damping")[0] == 400
    assert served.ask(f"/api/versions/diff?before={parent.id}&after={child.id}")[1]["words"] == []
    steps = served.ask(f"/api/versions/ladder?version={child.id}")[1]["steps"]
    assert [step["mse_rad2"] for step in steps] == [4e-4, 1e-4, 1e-4]


def test_a_window_is_reduced_with_its_peaks_and_exact_when_small(workbench: Any, tmp_path: Path) -> None:
    twin = TwinModel.load(load_hand())
    recording = recorded(twin, FINGER, np.random.default_rng(1), seconds=60.0)
    column, position = recording.joints.index("rh_FFJ3"), recording.position.copy()
    position[4321, column] += 0.7
    recording = replace(recording, position=position)
    saved(recording, tmp_path / "long.mcap")
    served = workbench("--folder", str(tmp_path))
    (offer,) = served.ask("/api/recordings")[1]["recordings"]
    query = f"recording={offer['id']}&version=nominal&joint=rh_FFJ3"
    assert served.ask(f"/api/recording?{query}")[1]["samples"] == len(recording.stamp_ns)

    def window(more: str = "") -> dict[str, Any]:
        return until(lambda: not (found := served.ask(f"/api/window?{query}{more}")[1])["pending"] and found, 40.0)

    whole = window()
    curve = whole["curves"]["rh_FFJ3"]
    assert not whole["exact"]
    assert len(curve["t"]) < whole["samples"] == len(recording.stamp_ns)
    assert max(curve["measured"]) == pytest.approx(position[4321, column], abs=1e-6)
    near = window("&from=34.5&to=34.7")
    curve = near["curves"]["rh_FFJ3"]
    assert near["exact"]
    first = round(curve["t"][0] * 125)
    assert curve["t"][0] < 34.5 < 34.7 < curve["t"][-1]
    assert curve["measured"] == pytest.approx(position[first : first + len(curve["t"]), column], abs=1e-6)
    later = window("&from=34.5&to=34.7&lag_ms=8")["curves"]["rh_FFJ3"]
    assert later["twins"]["nominal"][1:] == pytest.approx(curve["twins"]["nominal"][:-1], abs=1e-4)
    for wrong in ("&from=nan", "&joint=nobody", "&version=a&version=b&version=c", "&lag_ms=much"):
        assert served.ask(f"/api/window?{query}{wrong}")[0] == 400


@pytest.fixture
def manager(monkeypatch: pytest.MonkeyPatch) -> Iterator[Manager]:
    made = Manager()
    monkeypatch.setenv("NOTIFY_SOCKET", made.name)
    monkeypatch.setenv("WATCHDOG_USEC", "400000")
    yield made
    made.socket.close()


def test_the_service_manager_hears_that_it_is_ready_alive_and_stopping(manager: Manager, workbench: Any) -> None:
    served = workbench()
    assert manager.hear("READY=1") == ["READY=1"]
    assert len(manager.hear("WATCHDOG=1")) == 1
    manager.waiting()
    assert served.end() == 0
    assert "STOPPING=1" in manager.waiting()


def test_a_stop_does_not_wait_for_a_long_roll_out(workbench: Any, tmp_path: Path) -> None:
    """A service that goes on computing after SIGTERM is killed in the end."""
    made = recorded(TwinModel.load(load_hand()), FINGER, np.random.default_rng(1), seconds=60.0)
    hour = [made.stamp_ns[0] + 60 * (stamps - made.stamp_ns[0]) for stamps in (made.stamp_ns, made.commands.stamp_ns)]
    saved(replace(made, stamp_ns=hour[0], commands=replace(made.commands, stamp_ns=hour[1])), tmp_path / "hour.mcap")
    served = workbench("--folder", str(tmp_path))
    (offer,) = served.ask("/api/recordings")[1]["recordings"]
    query = f"recording={offer['id']}&version=nominal&joint=rh_FFJ3"
    until(lambda: served.ask(f"/api/window?{query}")[1]["pending"], 40.0)
    time.sleep(2.0)
    assert served.ask(f"/api/window?{query}")[1]["pending"]
    assert served.end() == 0


def test_the_onset_is_estimated_until_somebody_knows_better(workbench: Any, tmp_path: Path) -> None:
    hand = load_hand()
    plan = load_trajectory("hand_closing", hand).by_command(hand)
    motion = {
        name: (plan.times_s.tolist(), column.tolist())
        for name, column in zip(plan.joints, plan.positions.T, strict=True)
    }
    made = recorded(
        TwinModel.load(hand), motion, np.random.default_rng(1), seconds=4.0, commands=False, late_s=0.5, name="late"
    )
    saved(made, tmp_path / "late.mcap")
    served = workbench("--recording", str(tmp_path / "late.mcap"), "--trajectory", "hand_closing")
    (offer,) = served.ask("/api/recordings")[1]["recordings"]

    def errors(more: str = "") -> dict[str, Any]:
        path = f"/api/errors?recording={offer['id']}&version=nominal{more}"
        return until(lambda: (found := served.ask(path)[1]) and not found.get("pending") and found, 60.0)

    estimated, given = errors(), errors("&onset_s=0.8")
    assert estimated["onset_estimated"]
    assert estimated["onset_s"] == pytest.approx(0.5, abs=0.02)
    assert (given["onset_s"], given["onset_estimated"]) == (0.8, False)
    assert given["mse_rad2"] > 10.0 * estimated["mse_rad2"]
    assert served.ask(f"/api/errors?recording={offer['id']}&version=nominal&onset_s=soon")[0] == 400


def test_from_another_machine_reading_needs_a_token_too(workbench: Any, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("no recording")
    served = workbench("--bind", "0.0.0.0", "--folder", str(tmp_path), "--name", "127.0.0.1")
    served.address = f"http://127.0.0.1:{served.address.rpartition(':')[2].partition('/')[0]}"
    for path in ("/api/recordings", "/api/hands", "/api/versions", "/api/job?kind=add", "/api/recording?recording=x"):
        assert served.ask(path)[0] == 401, path
    status, page = served.ask("/")
    assert (status, "facts" in page, "rh_" in page) == (401, False, False)
    with pytest.raises(InvalidStatus):
        connect(f"ws://{served.host}/live")
    assert served.ask("/static/entrance.js")[0] == 200
    assert served.ask("/api/stop", {}, token=False)[0] == 503  # anybody may: only the daemon is not there
    assert served.ask("/api/enter", {}, token=False)[0] == 401

    looks = looking_token(served.token)
    assert served.ask("/api/recordings", X_Twin_Token=looks)[0] == 200
    assert served.ask("/api/keep", {}, token=False, X_Twin_Token=looks)[0] == 401
    request = urllib.request.Request(served.address + "/api/enter", b"", {"X-Twin-Token": looks}, method="POST")
    with urllib.request.urlopen(request, timeout=20) as answer:
        cookie = answer.headers["Set-Cookie"]
    assert {"HttpOnly", "SameSite=strict"} <= set(cookie.split("; "))
    assert served.token not in cookie
    cookie = cookie.partition(";")[0]
    assert served.ask("/", Cookie=cookie)[0] == 200
    assert served.ask("/api/recordings", Cookie=cookie)[0] == 200
    assert served.ask("/api/keep", {}, token=False, Cookie=cookie)[0] == 401
    assert served.ask("/api/recordings", Cookie=cookie[:-1])[0] == 401
    with connect(f"ws://{served.host}/live", additional_headers={"Cookie": cookie}) as stream:
        assert json.loads(stream.recv(timeout=20))


def test_a_link_among_the_recordings_shows_nothing_of_what_it_leads_to(workbench: Any, tmp_path: Path) -> None:
    folder = tmp_path / "offered"
    (folder / "pair").mkdir(parents=True)
    (tmp_path / "secret").write_text("root:hunter2\nmore\n")
    for name in ("link.csv", "link.mcap", "pair/control.csv", "pair/state_motor.csv", "pair/joint_list.txt"):
        (folder / name).symlink_to(tmp_path / "secret")
    (folder / "plain.csv").write_text("root:hunter2\nmore\n")
    os.mkfifo(folder / "pipe.csv")
    served = workbench("--folder", str(folder))
    offers = served.ask("/api/recordings")[1]["recordings"]
    assert [offer["name"] for offer in offers] == ["plain.csv"]
    ids = [hashlib.sha256(str(folder / name).encode()).hexdigest()[:16] for name in ("link.csv", "pair", "pipe.csv")]
    for one in [offers[0]["id"], *ids]:
        status, answer = served.ask(f"/api/recording?recording={one}")
        assert (status, "hunter2" in json.dumps(answer)) == (400, False), answer


def test_no_answer_waits_for_an_acknowledgement() -> None:
    """Head and body are sent apart: without this the second waits 40 ms for the receipt of the first."""
    with listen("127.0.0.1", 0) as listener, socket.create_connection(listener.getsockname()):
        connection, _ = listener.accept()
        with connection:
            assert connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
