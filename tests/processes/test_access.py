"""Access control in real processes: denials are silent, so they are tested by what arrives."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
import zenoh

from bridges.zenoh.client import ask
from bridges.zenoh.commander import Commander
from bridges.zenoh.fleet import look
from bridges.zenoh.session import open_client
from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample
from twin_daemon.errors import NoAnswer
from twin_daemon.hand import load_hand
from twin_daemon.security.identity import load_keyring

NS = "shadow_hand"


@pytest.mark.parametrize("anonymous", ["look", "nothing"])
def test_each_may_do_what_his_role_says(
    twin: Any, tmp_path: Path, state_dir: Path, until: Any, monkeypatch: pytest.MonkeyPatch, anonymous: str
) -> None:
    config = tmp_path / "twin.yaml"
    config.write_text(yaml.safe_dump({"access": {"anonymous": anonymous}, "gate": {"state_timeout_s": 5.0}}))
    twin.start("run", "-c", str(config))
    keys = state_dir / "keys.json"
    until(keys.exists, 20.0)
    description = load_hand().description
    sessions: dict[str, zenoh.Session] = {}
    for name in ("hand", "operator", "viewer"):
        opened = open_client(twin.endpoint, 60.0, name=name)
        assert opened is not None
        sessions[name] = opened
    stranger = open_client(twin.endpoint, 1.0)
    assert (stranger is not None) == (anonymous == "look")
    if stranger is not None:
        sessions["anonymous"] = stranger
    try:
        for session in sessions.values():
            until(lambda session=session: list(look(session)) == [NS])
            assert look(session)[NS].hand == "shadow_hand"
        names = tuple(ask(sessions["viewer"], f"twin/{NS}/state", 60.0)["joints"])

        def received() -> int:
            return ask(sessions["viewer"], f"twin/{NS}/health", 60.0)["joint_states"]["received"]

        # what the gate has let through is heard by everybody, and said by nobody else
        passed: list[bytes] = []
        ear = sessions["viewer"].declare_subscriber(
            f"twin/{NS}/command/sent",
            lambda heard: passed.append(heard.payload.to_bytes()),
            allowed_origin=zenoh.Locality.REMOTE,
        )
        sample = cdr.encode(JointSample(0, names, np.zeros(24)))
        for name, session in sessions.items():
            if name != "hand":
                session.put(f"{NS}/joint_states", sample)
                session.put(f"{NS}/joint_commands", sample)
            session.put(f"twin/{NS}/command/sent", sample)
        time.sleep(0.5)
        assert received() == 0
        assert passed == []
        until(lambda: sessions["hand"].put(f"{NS}/joint_states", sample) or received() > 0)

        keyring = load_keyring(keys)
        monkeypatch.setattr("bridges.zenoh.commander._PATIENCE_S", 1.0)
        arm = {"reason": "a test"}
        operator = Commander(sessions["operator"], description, keyring, "operator")
        until(lambda: sessions["hand"].put(f"{NS}/joint_states", sample) or operator.ask("arm", **arm)["accepted"])
        assert operator.ask("move", targets={"rh_FFJ3": 0.01})["accepted"]
        until(lambda: passed)
        ear.undeclare()
        for name, session in sessions.items():
            if name == "operator":
                continue
            # with the operator's own key, but on a connection that may not command
            thief = Commander(session, description, keyring, "operator")
            thief._signer.session = operator._signer.session
            with pytest.raises(NoAnswer):
                thief.ask("disarm", 1.0)
        assert operator.status()["mode"] == "armed"
        assert Commander(sessions["viewer"], description).ask("stop", reason="anybody may")["accepted"]
        assert operator.status()["mode"] == "stopped"
    finally:
        for session in sessions.values():
            session.close()


def test_a_wrong_password_gets_no_session(
    twin: Any, tmp_path: Path, state_dir: Path, until: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = tmp_path / "twin.yaml"
    config.write_text("access: {}\n")
    twin.start("run", "-c", str(config))
    until((state_dir / "keys.json").exists, 20.0)
    opened = open_client(twin.endpoint, 60.0)
    assert opened is not None
    opened.close()
    monkeypatch.setattr("bridges.zenoh.session.credentials", lambda _name: ("operator", "guessed"))
    assert open_client(twin.endpoint, 1.0) is None
