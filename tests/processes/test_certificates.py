"""Certificates of the installation's own authority, in real processes: who has none stays outside."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
import zenoh

from bridges.zenoh.client import ask
from bridges.zenoh.commander import Commander
from bridges.zenoh.session import open_client, session_config
from twin_daemon.cli.app import main
from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample
from twin_daemon.errors import NoAnswer
from twin_daemon.hand import load_hand
from twin_daemon.security.certificate_authority import Authority
from twin_daemon.security.identity import load_keyring
from twin_daemon.security.tls import DAEMON

NS = "shadow_hand"


@pytest.fixture
def guarded(twin: Any, tmp_path: Path, state_dir: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A daemon that takes nobody without a certificate; `ann`, a viewer, has been added beside the usual ones."""
    twin.endpoint = twin.endpoint.replace("tcp/", "tls/")
    twin._environment["TWIN_ENDPOINT"] = twin.endpoint
    assert main(["security", "init"]) == 0
    assert main(["security", "add", "ann"]) == 0
    monkeypatch.setattr("bridges.zenoh.commander._PATIENCE_S", 1.0)
    config = tmp_path / "twin.yaml"
    config.write_text(yaml.safe_dump({"access": {"certificates": True}, "gate": {"state_timeout_s": 5.0}}))
    daemon = twin.start("run", "-c", str(config))
    twin.query("health", 20.0)  # the command line looks with the viewer's certificate
    yield twin
    code, _, said = twin.end(daemon)
    assert code == 0, said
    keys = list(state_dir.rglob("key.pem"))
    owners = {"authority", DAEMON, *load_keyring(state_dir / "keys.json").names}
    assert sorted(path.parent.name for path in keys) == sorted(owners)
    for path in (*keys, state_dir / "keys.json"):
        for line in path.read_text().splitlines():
            assert len(line) < 24 or line.startswith("-----") or line not in said


def opened(endpoint: str, name: str) -> zenoh.Session:
    session = open_client(endpoint, 10.0, name=name)
    assert session is not None
    return session


def test_each_does_what_his_role_says_and_nobody_else_gets_in(
    guarded: Any, state_dir: Path, until: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    description, keyring = load_hand().description, load_keyring(state_dir / "keys.json")
    with (
        opened(guarded.endpoint, "hand") as hand,
        opened(guarded.endpoint, "operator") as operator,
        opened(guarded.endpoint, "ann") as ann,
    ):
        names = tuple(ask(ann, f"twin/{NS}/state", 60.0)["joints"])
        sample = cdr.encode(JointSample(0, names, np.zeros(24)))
        ann.put(f"{NS}/joint_states", sample)
        operator.put(f"{NS}/joint_states", sample)
        time.sleep(0.3)
        assert ask(ann, f"twin/{NS}/health", 60.0)["joint_states"]["received"] == 0
        commander = Commander(operator, description, keyring, "operator")
        until(lambda: hand.put(f"{NS}/joint_states", sample) or commander.ask("arm", reason="a test")["accepted"])
        # a viewer who has stolen the operator's key still has the certificate of a viewer
        thief = Commander(ann, description, keyring, "operator")
        thief._signer.session = commander._signer.session
        with pytest.raises(NoAnswer):
            thief.ask("disarm", 1.0)
        assert commander.status()["mode"] == "armed"
        assert Commander(ann, description).ask("stop", reason="anybody who is in may")["accepted"]

    # none, one that nobody vouches for, and one of another authority of the same name
    bare = {"transport/link/tls": {"root_ca_certificate": str(state_dir / "security/ann/authority.pem")}}
    with pytest.raises(zenoh.ZError):
        zenoh.open(session_config("client", connect=[guarded.endpoint], more=bare))
    Authority(tmp_path / "other").issue("operator")
    monkeypatch.setenv("TWIN_SECURITY", str(tmp_path / "other" / "operator"))
    assert open_client(guarded.endpoint, 1.0) is None
    shutil.copy(state_dir / "security/ann/authority.pem", tmp_path / "other/operator/authority.pem")
    assert open_client(guarded.endpoint, 1.0) is None
    monkeypatch.delenv("TWIN_SECURITY")
    # in the clear, too
    assert open_client(guarded.endpoint.replace("tls/", "tcp/"), 1.0) is None
    assert guarded.query("health")["status"]


def test_one_folder_is_all_that_another_machine_needs(
    guarded: Any, state_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    carried = shutil.copytree(state_dir / "security" / "operator", tmp_path / "carried")
    guarded._environment |= {"TWIN_SECURITY": str(carried), "TWIN_STATE_DIR": str(tmp_path / "elsewhere")}
    code, _, said = guarded.run("command", "stop", "--reason", "a test")
    assert code == 0, said
    code, _, said = guarded.run("command", "release", "--reason", "a test")
    assert code == 0, said
    code, out, said = guarded.run("command", "status", "--json", "-")
    assert code == 0, said
    assert json.loads(out)["mode"] == "read_only"


def test_certificates_and_endpoint_belong_together(twin: Any, tmp_path: Path) -> None:
    config = tmp_path / "twin.yaml"
    config.write_text("access: {certificates: true}\n")
    code, _, said = twin.run("run", "-c", str(config))
    assert (code, len(said.strip().splitlines())) == (3, 1)
    assert "tls/" in said
    code, _, said = twin.run("run", "--endpoint", twin.endpoint.replace("tcp/", "tls/"))
    assert code == 3
    assert "certificates" in said
    code, _, said = twin.run("run", "-c", str(config), "--endpoint", twin.endpoint.replace("tcp/", "tls/"))
    assert code == 3
    assert "twin security init" in said
