"""A driver that offers its stop as a ROS 2 service, in real processes: called with every stop of the gate."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.bridges.ros_network import Peer, needs_ros
from tests.processes.conftest import Twin, until
from twin_daemon.resources import models_dir

pytestmark = needs_ros


def described(tmp_path: Path, **stop: Any) -> str:
    """The Shadow Hand with a driver that can be stopped."""
    folder = tmp_path / "described"
    shutil.copytree(models_dir() / "shadow_hand", folder)
    raw = yaml.safe_load((folder / "hand.yaml").read_text()) | {"stop": stop}
    (folder / "hand.yaml").write_text(yaml.safe_dump(raw))
    return str(folder / "hand.yaml")


def stopped(twin: Twin, hand: str) -> dict[str, Any]:
    code, out, err = twin.run("command", "stop", "--hand", hand, "--json", "-")
    assert code == 0, err
    return json.loads(out)


@pytest.mark.parametrize(
    ("kind", "works", "calls"),
    [
        pytest.param("SetBool", True, [True], id="set-bool", marks=pytest.mark.slow),
        pytest.param("Trigger", False, [None], id="refused"),
    ],
)
def test_the_service_is_called_and_its_answer_told(
    twin: Twin, tmp_path: Path, peers: tuple[Peer, Peer], kind: str, works: bool, calls: list[bool | None]
) -> None:
    driver, operator = peers
    service = f"/driver/halt_{kind.lower()}"
    hand = described(tmp_path, ros_service=service, ros_type=f"std_srvs/{kind}")
    twin.start("run", "--hand", hand)
    bridge = twin.start("bridge", "ros2", "--hand", hand)
    twin.query("health", 60.0)
    # before the driver is there, that is what is said
    told = until(
        lambda: (found := stopped(twin, hand)["driver_stop"])["why"] and "no ROS 2" in found["why"] and found, 60.0
    )
    assert told["done"] is False
    driver.do("offer", name=service, kind=kind, success=works)
    told = until(lambda: (found := stopped(twin, hand)["driver_stop"]) and driver.do("take")[service] and found, 60.0)
    assert told["what"] == f"service {service}"
    assert told["done"] is works
    assert works or told["why"] == "the driver is busy"
    # over ROS, too, a stop reaches the driver, and says whether it did
    reply = operator.do("call", name="twin/stop")
    assert ("was called" in reply["message"]) is works
    assert ("FAILED: the driver is busy" in reply["message"]) is not works
    assert "no certified stop" in reply["message"]
    assert driver.do("take")[service] == calls
    twin.end(bridge, 20.0)
