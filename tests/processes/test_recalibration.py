"""The twin follows the wear by itself, and goes back when a version does not keep what it promised."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import psutil
import pytest
import yaml

from bridges.zenoh.client import ask
from bridges.zenoh.commander import Commander
from bridges.zenoh.session import open_client
from twin_daemon.hand import load_hand
from twin_daemon.security.identity import load_keyring
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import Draft, VersionStore

NS = "shadow_hand"


def configured(tmp_path: Path, **recalibration: Any) -> str:
    path = tmp_path / "twin.yaml"
    path.write_text(yaml.safe_dump({"recalibration": recalibration, "gate": {"command_age_s": 60.0}}))
    return str(path)


@pytest.mark.slow
def test_a_hand_that_wears_gets_a_better_version_also_through_a_restart(
    twin: Any, tmp_path: Path, state_dir: Path, until: Any
) -> None:
    config = configured(tmp_path, mode="passive", policy="automatic", seconds=4.0, nice=0, cron="0 3 * * mon")
    daemon = twin.start("run", "-c", config)
    twin.start("hand", "--hidden", "viscous_friction:rh_FFJ3=0.4", "--trajectory", "rich_finger", "--spread", "0")
    session = open_client(twin.endpoint, 60.0)
    assert session is not None
    with session:
        told = ask(session, f"twin/{NS}/recalibration", 60.0)
        assert "Monday" in told["words"]
        until(lambda: ask(session, f"twin/{NS}/residual")["joints"]["rh_FFJ3"]["samples"] > 1200, 40.0)
        nobody = Commander(session, load_hand().description)
        assert not nobody.ask("recalibrate")["accepted"]
        operator = Commander(session, load_hand().description, load_keyring(state_dir / "keys.json"), "operator")
        assert operator.ask("recalibrate", 60.0)["accepted"]
        assert operator.ask("recalibrate", 60.0)["check"] == "recalibration"
        # the machine loses its power; what had begun is begun again
        (child,) = [one for one in psutil.Process(daemon.pid).children() if "gate" not in one.cmdline()]
        daemon.kill()
        child.kill()
        twin.start("run", "-c", config)
        last = until(lambda: ask(session, f"twin/{NS}/recalibration", 30.0)["last"], 200.0)
        assert "error" not in last, last
        assert last["gain"] > 0.5
        assert last["better"], last
        until(lambda: ask(session, f"twin/{NS}/version", 60.0)["id"] == last["version"], 20.0)
        kinds = [event["kind"] for event in ask(session, f"twin/{NS}/events", 60.0)["events"]]
        assert kinds.count("recalibration") == 3
    code, out, _ = twin.run("versions", "show", "current", "--json", "-")
    assert code == 0
    assert json.loads(out)["kind"] == "recalibrated"


@pytest.mark.slow
def test_a_first_promotion_that_misbehaves_is_rolled_back_to_the_nominal_model(
    twin: Any, tmp_path: Path, until: Any
) -> None:
    store = VersionStore(NS)
    model = TwinModel.load(load_hand())

    def stored(title: str, gain: float, promised: float) -> str:
        bad = model.changed(model.terms.with_parameters({"rh_FFJ3.kp": gain, "rh_MFJ3.kp": gain, "rh_RFJ3.kp": gain}))
        draft = Draft(
            hand=NS,
            kind="calibrated",
            terms=bad.terms.as_json(),
            title=title,
            errors={"holdout_after": {"mse_rad2": promised}},
        )
        return store.add(draft, bad.mjcf()).id

    bad = stored("bad", 0.02, 1e-6)
    twin.start("run", "-c", configured(tmp_path))
    twin.start("hand", "--trajectory", "hand_closing")
    session = open_client(twin.endpoint, 60.0)
    assert session is not None
    with session:
        until(lambda: ask(session, f"twin/{NS}/residual", 60.0)["joints"]["rh_FFJ3"]["samples"] > 500, 40.0)
        received = ask(session, f"twin/{NS}/health")["joint_states"]["received"]
        store.promote(bad)
        until(lambda: ask(session, f"twin/{NS}/version")["id"] == bad, 10.0)
        until(lambda: store.aliases()["current"] == "nominal", 25.0)
        until(lambda: ask(session, f"twin/{NS}/version")["id"] == "nominal", 10.0)
        health = ask(session, f"twin/{NS}/health")
        assert health["joint_states"]["received"] > received
        assert health["loop"]["dropped"] == 0
        events = ask(session, f"twin/{NS}/events")["events"]
        assert [event["kind"] for event in events].count("rollback") == 1
    assert "rolled back by itself" in store.notes()[bad][0].text
