"""What the live twin knows, as its answers say it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from twin_daemon.daemon.configuration import load_config
from twin_daemon.daemon.messages import JointSample
from twin_daemon.daemon.residual import Residual
from twin_daemon.daemon.service import TwinService
from twin_daemon.errors import BadInput
from twin_daemon.simulation.twin import TwinModel

Make = Callable[..., Any]


def feed(service: TwinService, clock: Any, joint_state: Make, seconds: float, position: float = 0.1) -> None:
    """Joint states at 125 Hz in step with the clock."""
    begin_s = clock.now_s - 100.0
    for sample in range(round(seconds * 125)):
        clock.now_s = 100.0 + begin_s + sample * 0.008
        service.on_joint_state(joint_state(begin_s + sample * 0.008, position))
    clock.now_s += 0.008


def test_every_answer_is_plain_json_before_anything_arrived(make_service: Make) -> None:
    service = make_service()
    for answer in (service.state, service.residual, service.health, service.drift, service.version, service.model):
        value = json.loads(json.dumps(answer(), allow_nan=False))
        assert value["schema"] == 1
    state = service.state()
    assert state["status"] == "waiting"
    assert len(state["joints"]) == 24
    assert state["joints"]["rh_FFJ3"]["measured_rad"] is None
    assert state["joints"]["rh_FFJ3"]["stale"] is True


def test_all_joints_are_fresh_while_data_arrive_and_stale_after(
    make_service: Make, clock: Any, joint_state: Make
) -> None:
    service = make_service()
    feed(service, clock, joint_state, 1.0)
    state = service.state()
    assert state["fresh_joints"] == 24
    assert state["status"] == "no_commands"
    assert state["joints"]["rh_FFJ3"]["measured_rad"] == pytest.approx(0.1)
    assert state["joints"]["rh_FFJ3"]["predicted_rad"] == pytest.approx(0.1, abs=0.2)
    assert state["joints"]["rh_FFJ3"]["age_s"] == pytest.approx(0.008)
    clock.now_s += 3.0
    state = service.state()
    assert (state["status"], state["stale"], state["fresh_joints"]) == ("stale", True, 0)
    assert state["joints"]["rh_FFJ3"]["age_s"] == pytest.approx(3.008)


def test_partial_messages_still_mirror_all_joints(make_service: Make, twin: TwinModel, joint_state: Make) -> None:
    service = make_service()
    half = len(twin.joints) // 2
    service.on_joint_state(joint_state(0.000, 0.1, twin.joints[:half]))
    assert service.state()["fresh_joints"] == half
    service.on_joint_state(joint_state(0.004, 0.1, twin.joints[half:]))
    service.on_joint_state(joint_state(0.008, 0.1, twin.joints[:half]))
    state = service.state()
    assert state["fresh_joints"] == 24
    stamps = {joint["stamp_ns"] for joint in state["joints"].values()}
    assert len(stamps) == 2, "each joint keeps its own stamp"


def test_a_joint_whose_sensor_breaks_goes_stale_alone(make_service: Make, twin: TwinModel, clock: Any) -> None:
    service = make_service()
    for sample in range(200):
        clock.now_s = 100.0 + sample * 0.008
        position = np.full(24, 0.1)
        if sample > 50:
            position[3] = np.nan
        service.on_joint_state(JointSample(clock.wall_ns(), twin.joints, position))
    state = service.state()
    assert [name for name, joint in state["joints"].items() if joint["stale"]] == [twin.joints[3]]
    assert service.health()["joint_states"]["counts"] == {"not_finite": 149}
    assert all(joint["predicted_rad"] is not None for joint in state["joints"].values())


def test_the_mirrored_hand_stands_in_space(make_service: Make, clock: Any, joint_state: Make) -> None:
    service = make_service()
    assert service.state()["mirror"]["complete"] is False
    feed(service, clock, joint_state, 0.1, position=0.0)
    open_hand = service.state()["mirror"]
    feed(service, clock, joint_state, 0.1, position=0.3)
    bent = service.state()["mirror"]
    assert open_hand["complete"]
    assert len(open_hand["fingertips"]) == 5
    moved = [
        np.subtract(bent["fingertips"][n]["position_m"], tip["position_m"])
        for n, tip in open_hand["fingertips"].items()
    ]
    assert all(0.005 < np.linalg.norm(step) < 0.2 for step in moved)
    assert bent["tendons"] != open_hand["tendons"]
    assert all(contact["distance_m"] < 0.01 for contact in bent["contacts"])


def test_the_error_stands_beside_what_the_version_showed(make_service: Make) -> None:
    service = make_service()
    assert service.residual()["promoted_mse_rad2"] is None
    errors = {"after": {"mse_rad2": 1e-5}, "holdout_after": {"mse_rad2": 2e-5}}
    service.use(service.ready(service.predictor.twin), {"id": "fitted", "errors": errors})
    assert service.residual()["promoted_mse_rad2"] == 2e-5


def test_a_clock_that_is_set_is_an_event_and_no_loss(make_service: Make, clock: Any, joint_state: Make) -> None:
    service = make_service()
    feed(service, clock, joint_state, 1.0)
    ahead_s = 1000.0 + clock.now_s
    for sample in range(100):
        clock.now_s += 0.008
        service.on_joint_state(joint_state(ahead_s + sample * 0.008, 0.1))
    timing = service.health()["timing"]
    assert (timing["clock_jumps"], timing["missing"]) == (1, 0)
    assert "clock_jump" in [event["kind"] for event in service.recent_events()["events"]]
    assert service.state()["status"] == "no_commands"


def test_a_residual_is_measured_minus_predicted(make_service: Make, clock: Any, joint_state: Make) -> None:
    service = make_service(horizon_s=100.0)
    service.on_command(JointSample(0, ("rh_FFJ3",), np.array([1.0])))
    feed(service, clock, joint_state, 2.0)
    joint = service.state()["joints"]["rh_FFJ3"]
    assert joint["residual_rad"] == pytest.approx(joint["measured_rad"] - joint["predicted_rad"])
    report = service.residual()
    assert report["status"] == "following"
    assert report["joints"]["rh_FFJ3"]["rmse_rad"] > 0.5
    assert report["joints"]["rh_FFJ3"]["bias_rad"] < -0.5
    assert report["prediction"]["anchor_reason"] == "start"


def test_a_prediction_goes_out_before_it_is_compared(make_service: Make, clock: Any, joint_state: Make) -> None:
    service = make_service(horizon_s=100.0)
    feed(service, clock, joint_state, 0.4)

    def samples() -> int:
        return service.residual()["joints"]["rh_FFJ3"]["samples"]

    before = samples()
    sent: list[tuple[JointSample, int]] = []
    output = service.on_joint_state(joint_state(0.4), lambda prediction: sent.append((prediction, samples())))
    assert [seen for _, seen in sent] == [before]
    assert output.prediction is sent[0][0]
    assert samples() == before + 1


def test_a_prediction_that_cannot_be_sent_is_compared_all_the_same(
    make_service: Make, clock: Any, joint_state: Make
) -> None:
    service = make_service(horizon_s=100.0)
    feed(service, clock, joint_state, 0.4)

    def fail(_: JointSample) -> None:
        raise OSError("the network is down")

    before = service.residual()["joints"]["rh_FFJ3"]["samples"]
    with pytest.raises(OSError, match="down"):
        service.on_joint_state(joint_state(0.4), fail)
    assert service.residual()["joints"]["rh_FFJ3"]["samples"] == before + 1


def test_commands_of_another_clock_hold_from_now_and_are_counted(
    make_service: Make, clock: Any, joint_state: Make
) -> None:
    service = make_service()
    feed(service, clock, joint_state, 0.1)
    assert service.on_command(JointSample(12_345, ("rh_FFJ3",), np.array([1.0])))
    feed(service, clock, joint_state, 0.5)
    assert service.state()["joints"]["rh_FFJ3"]["predicted_rad"] > 0.5
    assert service.health()["joint_commands"]["counts"] == {"other_clock": 1}


def test_bad_commands_are_counted_by_kind_and_change_nothing(make_service: Make, clock: Any, joint_state: Make) -> None:
    service = make_service()
    feed(service, clock, joint_state, 0.1)
    for names, position in (
        ((), []),
        (("rh_FFJ3",), [0.1, 0.2]),
        (("gripper",), [0.1]),
        (("rh_FFJ3",), [np.nan]),
        (("rh_FFJ3",), [1e9]),
        (("rh_FFJ3", "rh_FFJ3"), [0.1, 0.2]),
    ):
        assert not service.on_command(JointSample(0, names, np.array(position)))
    counts = service.health()["joint_commands"]["counts"]
    assert set(counts) == {
        "duplicate_names", "empty", "length_mismatch", "no_stamp", "not_finite", "out_of_range", "unknown_names",
    }  # fmt: skip
    assert service.state()["commands"]["targets_rad"] == {}


def test_another_version_takes_over_without_a_break(
    make_service: Make, clock: Any, joint_state: Make, twin: TwinModel
) -> None:
    service = make_service()
    service.on_command(JointSample(0, ("rh_FFJ3",), np.array([0.4])))
    feed(service, clock, joint_state, 0.5)
    service.take_events()
    service.use(service.ready(TwinModel.load(twin.hand)), {"id": "v2"})
    feed(service, clock, joint_state, 0.5)
    state = service.state()
    assert (state["version"], state["status"], state["fresh_joints"]) == ("v2", "following", 24)
    assert state["commands"]["targets_rad"] == {"rh_FFJ3": 0.4}
    assert [event.kind for event in service.take_events()] == ["version", "anchored"]


def test_a_replayed_stream_is_taken_up_again(make_service: Make, clock: Any, joint_state: Make) -> None:
    service = make_service()
    feed(service, clock, joint_state, 1.0)
    for sample in range(50):
        service.on_joint_state(joint_state(-500 + sample * 0.008, 0.2))
    state = service.state()
    assert state["joints"]["rh_FFJ3"]["measured_rad"] == pytest.approx(0.2)
    assert service.health()["joint_states"]["counts"]["stamps_restarted"] == 1


def test_the_model_in_use_compiles_on_its_own(make_service: Make) -> None:
    import mujoco

    answer = make_service().model()
    assert mujoco.MjModel.from_xml_string(answer["mjcf"]).nu == 20


def test_residual_statistics_are_exact_over_the_window() -> None:
    residual = Residual(1, window_s=5.0)
    for sample in range(2000):
        residual.add(sample * 10_000_000, np.array([1.0 if sample < 1000 else 0.5]))
    statistics = residual.statistics()
    assert statistics.bias_rad[0] == pytest.approx(0.5)
    assert statistics.mse_rad2[0] == pytest.approx(0.25)
    assert 500 <= statistics.samples[0] <= 600


@pytest.mark.parametrize(
    ("text", "named"),
    [("horizon: 3\n", "horizon"), ("daemon: {horizn_s: 3}\n", "horizon_s"), ("daemon: {horizon_s: -1}\n", "horizon_s")],
)
def test_a_wrong_configuration_names_the_key(tmp_path: Path, text: str, named: str) -> None:
    path = tmp_path / "twin.yaml"
    path.write_text(text)
    with pytest.raises(BadInput, match=named) as caught:
        load_config(path, {})
    assert "\n" not in str(caught.value)


def test_paths_in_a_configuration_are_relative_to_it(tmp_path: Path) -> None:
    path = tmp_path / "twin.yaml"
    path.write_text("model: arm.xml\nendpoint: tcp/127.0.0.1:7000\n")
    assert load_config(path, {}).config.model == tmp_path / "arm.xml"
