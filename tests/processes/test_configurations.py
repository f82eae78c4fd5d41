"""Every configuration of the documentation carries the hand to the twin and a command to the hand.

With the shipped processes alone: a test that listens beside them opens ways on the network that they do not have.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.processes.conftest import free_port
from twin_daemon.daemon.configuration import load_config
from twin_daemon.daemon.settings import TwinConfig

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([ROOT / "README.md", ROOT / "systemd" / "README.md", *(ROOT / "docs").glob("*.md")])
OWN = {"endpoint", "hand"}
"""Where a test has its own: a free port; the Shadow Hand is the one of the documentation, too."""

ACCESS = {
    "none": None,
    "password": {},
    "nobody-unknown": {"anonymous": "nothing"},
    "certificate": {"certificates": True},
}
ROS = {
    "none": None,
    "password": {"transport": "ros2dds"},
    "nobody-unknown": {"transport": "rmw_zenoh", "domain": 0},
    "certificate": {"transport": "ros2dds"},
}


def documented() -> Iterator[tuple[str, dict[str, Any]]]:
    """Page and content of each piece of a daemon's configuration that the documentation shows, comments included."""
    known = set(TwinConfig.model_fields)
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        blocks = re.findall(r"^```yaml\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
        inline = re.findall(rf"`((?:{'|'.join(known)}): [^`\n]+)`", text)
        commented = re.findall(r"^# ((?:access|ros): \{[^}]*\})", "\n".join(blocks), re.MULTILINE)
        for piece in (*blocks, *inline, *commented):
            found = yaml.safe_load(piece) if "HOST" not in piece and "..." not in piece else None
            if isinstance(found, dict) and found and set(found) <= known:
                yield page.name, found


def configuration(kind: str) -> dict[str, Any]:
    """All that the documentation sets and that can be set together, with one kind of access and of ROS."""
    merged: dict[str, Any] = {}
    for _, piece in documented():
        for key, value in piece.items():
            if key not in (*OWN, "access", "ros", "namespace"):
                merged[key] = merged.get(key, {}) | value if isinstance(value, dict) else value
    merged["daemon"]["metrics_port"] = free_port()
    return merged | {
        name: chosen[kind] for name, chosen in (("access", ACCESS), ("ros", ROS)) if chosen[kind] is not None
    }


def test_all_that_is_documented_is_run_here(tmp_path: Path) -> None:
    pieces = list(documented())
    assert len(pieces) > 6
    run = [configuration(kind) for kind in ACCESS]
    accesses, transports = list(ACCESS.values()), [ros["transport"] for ros in ROS.values() if ros is not None]
    for page, piece in pieces:
        path = tmp_path / "twin.yaml"
        path.write_text(yaml.safe_dump(piece))
        load_config(path, {})
        if "access" in piece and piece["access"].get("anonymous") != "look":  # that is what it is without
            assert piece["access"] in accesses, page
        if "ros" in piece:
            assert piece["ros"]["transport"] in transports, page
        for key in piece.keys() - OWN - {"access", "ros", "namespace"}:
            assert all(key in one for one in run), page


@pytest.mark.parametrize(
    "kind", [kind if kind == "certificate" else pytest.param(kind, marks=pytest.mark.slow) for kind in ACCESS]
)
def test_states_arrive_and_commands_reach_the_hand(
    kind: str, twin: Any, tmp_path: Path, state_dir: Path, until: Any
) -> None:
    settings = configuration(kind)
    settings["gate"] = settings.get("gate", {}) | {"state_timeout_s": 5.0}  # other work may hold up this machine
    if kind == "certificate":
        twin.endpoint = twin.endpoint.replace("tcp/", "tls/")
        twin._environment["TWIN_ENDPOINT"] = twin.endpoint
        code, _, said = twin.run("security", "init")
        assert code == 0, said
    config = tmp_path / "twin.yaml"
    config.write_text(yaml.safe_dump(settings))
    daemon = twin.start("run", "-c", str(config))
    until((state_dir / "keys.json").exists, 30.0)
    twin.query("health", 30.0, who="viewer")
    hand = twin.start("hand", "--trajectory", "none", who="hand")
    until(lambda: twin.query("health", who="viewer")["joint_states"]["accepted"] > 50, 30.0)
    commands = (["arm", "--reason", "a test"], ["move", "rh_FFJ3=0.1"])
    for verb, *more in commands:
        until(lambda verb=verb, more=more: twin.run("command", verb, *more, "--as", "operator", who="operator")[0] == 0)
    code, out, said = twin.run("record", "--seconds", "3", "-o", str(tmp_path / "it.mcap"), "--json", "-", who="viewer")
    assert code == 0, said
    assert json.loads(out)["messages"] > 0
    followed = re.search(r"(\d+) commands of others followed", twin.end(hand)[2])
    assert followed is not None
    assert int(followed[1]) > 0
    code, _, said = twin.end(daemon)
    assert code == 0, said
