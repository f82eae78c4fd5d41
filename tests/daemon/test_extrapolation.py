"""The live twin says where its version was not fitted."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from tests.daemon.conftest import Clock
from twin_daemon.daemon.extrapolation import Extrapolation
from twin_daemon.daemon.ready import Ready
from twin_daemon.daemon.service import TwinService
from twin_daemon.daemon.settings import DaemonSettings
from twin_daemon.simulation.twin import TwinModel

SEEN = {"joints": {"rh_FFJ3": {"position": [0.0, 1.0], "speed": [0.0, 2.0], "load": [-0.5, 0.5]}}}


@pytest.mark.parametrize(
    ("position", "velocity", "outside"),
    [
        (0.5, 1.0, set()),
        (1.05, 0.0, set()),
        (1.4, 1.0, {"position"}),
        (0.5, -4.0, {"speed"}),
        (-0.3, 3.0, {"position", "speed"}),
    ],
)
def test_what_a_version_has_not_seen_is_named(
    position: float, velocity: float, outside: set[str], twin: TwinModel
) -> None:
    column = twin.joints.index("rh_FFJ3")
    states, speeds = np.zeros(len(twin.joints)), np.zeros(len(twin.joints))
    states[column], speeds[column] = position, velocity
    extrapolation = Extrapolation(twin)
    extrapolation.use(SEEN)
    found = extrapolation.at(states, speeds)
    assert found["known"] is True
    assert {one["quantity"] for one in found["outside"]} == outside
    for one in found["outside"]:
        assert one["joint"] == "rh_FFJ3"
        assert one["seen"] == SEEN["joints"]["rh_FFJ3"][one["quantity"]]


def test_a_load_that_was_never_carried_is_outside(twin: TwinModel) -> None:
    light = {"joints": {"rh_WRJ1": {"position": [-1.0, 1.0], "speed": [0.0, 2.0], "load": [5.0, 6.0]}}}
    extrapolation = Extrapolation(twin)
    extrapolation.use(light)
    (found,) = extrapolation.at(np.zeros(len(twin.joints)), np.zeros(len(twin.joints)))["outside"]
    assert (found["joint"], found["quantity"], found["unit"]) == ("rh_WRJ1", "load", "N m")


def test_the_state_says_so_and_says_where_nothing_is_known(twin: TwinModel, clock: Clock, joint_state: Any) -> None:
    service = TwinService(twin, {"id": "nominal"}, DaemonSettings(), monotonic_s=clock, wall_ns=clock.wall_ns)
    service.on_joint_state(joint_state(0.0, 1.4, ("rh_FFJ3",)))
    assert service.state()["region"] == {"known": False, "outside": []}
    service.use(Ready.made(twin, service.settings), {"id": "fitted", "region": SEEN})
    said = json.loads(json.dumps(service.state(), allow_nan=False))["region"]
    assert said["known"] is True
    assert [(one["joint"], one["quantity"], one["here"]) for one in said["outside"]] == [("rh_FFJ3", "position", 1.4)]
    assert service.health()["outside"] == ["rh_FFJ3: position 1.4 rad, fitted in 0 to 1"]
