"""A cause that is one for all servos: named once, and added, fitted, stepped to and removed as one."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.diagnosis.conftest import called, said_of_case
from tests.diagnosis.rig import DELAY_S, LAZY, SERVOS, changed_rig, late_rig
from twin_daemon.cli.app import main
from twin_daemon.diagnosis import everywhere
from twin_daemon.diagnosis.group import at_nominal, look
from twin_daemon.diagnosis.search import diagnose
from twin_daemon.diagnosis.shared import SharedSearch
from twin_daemon.diagnosis.shared_cause import SharedCause
from twin_daemon.diagnosis.thresholds import DEVIATING_SIGMA
from twin_daemon.effects import LIBRARY
from twin_daemon.errors import BadInput
from twin_daemon.estimation.partition import Reduction
from twin_daemon.hand import load_hand
from twin_daemon.places import ROBOT
from twin_daemon.recordings.load import load_recording
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.submodel import drive_groups
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.workflows.session import open_session


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """(model, recording) of a rig whose commands all come late."""
    model, bag = late_rig(tmp_path_factory.mktemp("rig"))
    return str(model), str(bag)


def _delays(terms: dict) -> dict[str, float]:
    return {t["target"]: t["values"]["delay"] for t in terms["effects"] if t["effect"] == "command_delay"}


def test_the_whole_robot_stands_for_each_of_its_servos(late: tuple[str, str]) -> None:
    nominal = TwinModel.load(load_hand(model=Path(late[0])))
    alone = EffectTerm(effect="command_delay", target="left", values={"delay": 0.5})
    everywhere = EffectTerm(effect="command_delay", target=ROBOT, values={"delay": 0.01})
    twin = nominal.changed(Terms(effects=(alone, everywhere)))
    assert _delays(twin.terms.as_json()) == dict.fromkeys(SERVOS, 0.01)
    assert twin.joints_of(ROBOT) == SERVOS
    assert all(twin.terms.is_everywhere(term, twin.actuators, twin.joints) for term in twin.terms.effects)


def test_an_effect_that_nobody_knows_is_said_so_at_the_whole_robot_too(late: tuple[str, str]) -> None:
    nominal = TwinModel.load(load_hand(model=Path(late[0])))
    with pytest.raises(BadInput, match="gremlins"):
        nominal.changed(Terms(effects=(EffectTerm(effect="gremlins", target=ROBOT, values={}),)))


def test_an_effect_is_added_to_all_servos_and_removed_again(late: tuple[str, str], tmp_path: Path) -> None:
    model = ("--model", late[0])
    added = called(
        "add", "command_delay", "--joint", "robot", "--set", "delay=0.02", *model, result=tmp_path / "a.json"
    )
    assert added["targets"] == ["robot"]
    assert _delays(added["terms"]) == dict.fromkeys(SERVOS, 0.02)
    removed = called(
        "remove", "command_delay", "--joint", "robot", "--version", added["version"], *model, result=tmp_path / "r.json"
    )
    assert removed["terms"]["effects"] == []
    assert main(["remove", "command_delay", "--joint", "robot", *model]) == 3


def test_cold_grease_is_the_same_share_of_each_joints_own_friction(late: tuple[str, str], tmp_path: Path) -> None:
    added = called("add", "viscous_friction", "--joint", "robot", "--set", "damping=0", "--set", "share=0.5",
                   "--model", late[0], result=tmp_path / "a.json")  # fmt: skip
    nominal = TwinModel.load(load_hand(model=Path(late[0])))
    twin = nominal.changed(Terms.model_validate(added["terms"]))
    assert twin.model.dof_damping == pytest.approx(1.5 * nominal.model.dof_damping)
    assert (nominal.model.dof_damping > 0).all()
    removed = called("remove", "viscous_friction", "--joint", "robot", "--version", added["version"],
                     "--model", late[0], result=tmp_path / "r.json")  # fmt: skip
    assert removed["terms"]["effects"] == []


def test_what_is_no_matter_of_servos_has_no_place_at_all_of_them(
    late: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["add", "spring", "--joint", "robot", "--model", late[0]]) == 3
    assert "not on 'robot'" in capsys.readouterr().err


def test_one_value_is_fitted_for_all_servos(late: tuple[str, str], tmp_path: Path) -> None:
    model, bag = late
    added = called(
        "add", "command_delay", "--joint", "robot", "--model", model, "--recording", bag, result=tmp_path / "a.json"
    )
    assert list(added["parameters"]) == ["command_delay:robot.delay"]
    found = added["parameters"]["command_delay:robot.delay"]
    assert found["ci95"][0] < DELAY_S < found["ci95"][1]
    assert found["value"] == pytest.approx(DELAY_S, rel=0.05)
    assert set(_delays(added["terms"]).values()) == {found["value"]}
    assert added["holdout_after"]["mse_rad2"] < 0.05 * added["holdout_before"]["mse_rad2"]


@pytest.mark.slow
def test_a_cause_of_all_servos_is_the_first_step_of_the_ladder(late: tuple[str, str], tmp_path: Path) -> None:
    model, bag = late
    ladder = called("ladder", "--model", model, "--recording", bag, "--max-steps", "1", result=tmp_path / "l.json")
    first = ladder["steps"][1]
    assert (first["effect"], first["target"]) == ("command_delay", "robot")
    assert first["parameters"]["delay"] == pytest.approx(DELAY_S, rel=0.05)
    assert set(first["joints"]) == set(SERVOS)
    assert first["verdict"] == "within_noise"
    assert set(_delays(ladder["terms"])) == set(SERVOS)


@pytest.mark.slow
def test_a_bus_that_is_late_by_what_damping_could_nearly_do_is_named(tmp_path: Path) -> None:
    """Beside 2 mrad of noise damping, gain and delay, each within its prior, leave a floor and a half of 12 ms."""
    model, bag, other = changed_rig(tmp_path, "command_delay", {"delay": 0.012}, noise_rad=2e-3)
    said = called("diagnose", "--model", str(model), "--recording", str(bag), "--holdout", str(other),
                  result=tmp_path / "d.json")  # fmt: skip
    (found,) = said["findings"]
    assert (found["effect"], found["target"]) == ("command_delay", ROBOT)
    assert set(found["confusable_with"]) <= {"actuator_lag:robot"}
    low, high = found["parameters"]["delay"]["ci95"]
    assert low < 0.012 < high


@pytest.mark.parametrize(
    ("key", "values", "told"),
    [
        pytest.param("command_delay", {"delay": 0.03}, ("delay", 0.03), marks=pytest.mark.slow),
        pytest.param("viscous_friction", {"damping": 0.0, "share": 2.0}, ("share", 2.0), marks=pytest.mark.slow),
        # each gain alone is three of its sigma off, which may be; three that are off the same way are one cause
        ("actuator_gain", {"factor": 0.68, "limit": 1.0}, ("factor", 0.68)),
    ],
)
def test_what_all_joints_have_is_one_cause_and_named_once(
    key: str, values: dict[str, float], told: tuple[str, float], tmp_path: Path
) -> None:
    model, bag, other = changed_rig(tmp_path, key, values)
    said = called("diagnose", "--model", str(model), "--recording", str(bag), "--holdout", str(other),
                  result=tmp_path / "d.json")  # fmt: skip
    assert said["verdict"] in ("explained", "ambiguous")
    (found,) = said["findings"]
    assert (found["effect"], found["target"]) == (key, "robot")
    assert set(found["joints"]) == set(SERVOS)
    name, planted = told
    estimate = found["parameters"][name]
    assert estimate["ci95"][0] < planted < estimate["ci95"][1]
    assert estimate["value"] == pytest.approx(planted, rel=0.1)
    if limit := found["parameters"].get("limit"):  # no servo comes near it: nothing is said of it
        assert limit["value"] == 1.0
        assert limit["ci95"][1] - limit["ci95"][0] > 10.0


@pytest.mark.slow
@pytest.mark.parametrize(("frictions", "places"), [((0.1, 0.14, 0.2), {ROBOT}), ((0.1, 0.0, 0.2), {"left", "right"})])
def test_cold_grease_is_one_cause_though_no_two_joints_have_the_same_share_of_it(
    frictions: tuple[float, ...], places: set[str], tmp_path: Path
) -> None:
    """What one of them has nothing of is not the whole robot's."""
    first, *others = (
        EffectTerm(effect="coulomb_friction", target=servo, values={"friction": friction, "sticking": 0.0})
        for servo, friction in zip(SERVOS, frictions, strict=True)
    )
    model, bag, other = changed_rig(tmp_path, first.effect, first.values, *others, target=first.target)
    said = called("diagnose", "--model", str(model), "--recording", str(bag), "--holdout", str(other),
                  result=tmp_path / "d.json")  # fmt: skip
    assert said["verdict"] in ("explained", "ambiguous")
    assert {found["effect"] for found in said["findings"]} == {"coulomb_friction"}
    assert {found["target"] for found in said["findings"]} == places


def test_a_friction_that_sticks_and_one_that_creeps_are_both_fitted_at_all_joints(tmp_path: Path) -> None:
    """Where one begins it may leave less than the other, and far more where their fits end."""
    model, bag, _ = changed_rig(tmp_path, "coulomb_friction", {"friction": 0.0, "sticking": 0.0, "share": 5.0})
    session = open_session(None, model, version=None, terms=None, joint_map=None)
    train = session.recordings([bag], None)
    reduction = Reduction(session.twin, train, ())
    groups = [reduction.of(session.twin, group, group.joints) for group in drive_groups(session.twin)]
    search = SharedSearch(session.twin, reduction, [at_nominal(group) for group in groups if group])
    cause = SharedCause(LIBRARY["coulomb_friction"], ROBOT)
    fitted = [search.fitted(begun)[0] for begun in search.begun(cause)]
    assert sorted(fit.values["sticking"] for fit in fitted) == [0.0, 1.0]
    best = min(fitted, key=lambda fit: fit.cost)
    assert best.values["sticking"] == 0.0
    assert best.values["share"] == pytest.approx(5.0, rel=0.1)


def test_what_one_servo_alone_is_off_by_asks_for_no_cause_of_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, bag, _ = changed_rig(tmp_path, "armature", {"armature": 0.012}, target="left", noise_rad=1e-3)
    session = open_session(None, model, version=None, terms=None, joint_map=None)
    train = session.recordings([bag], None)
    reduction = Reduction(session.twin, train, ())
    groups = [reduction.of(session.twin, group, group.joints) for group in drive_groups(session.twin)]
    looked_at = [look(group) for group in groups if group]
    off = [part.base.deviations[f"{part.joints[0]}.armature"] for _, part in looked_at]
    assert max(off) > 2.0 * DEVIATING_SIGMA  # so far that the mean of the three is far off as well
    assert sum(off) > len(off) ** 0.5 * DEVIATING_SIGMA
    assert all(part.within_floor for _, part in looked_at)

    def asked(*_: object) -> None:
        raise AssertionError("a cause of all servos was looked for")

    monkeypatch.setattr(everywhere, "SharedSearch", asked)
    assert everywhere.in_common(session.twin, reduction, looked_at, 0, print) is None


@pytest.mark.slow
def test_a_late_bus_is_every_servos_where_one_of_them_hardly_shows_it(tmp_path: Path) -> None:
    model, bag, other = changed_rig(tmp_path, "command_delay", {"delay": DELAY_S}, motion=LAZY, noise_rad=1e-3)
    said = called("diagnose", "--model", str(model), "--recording", str(bag), "--holdout", str(other),
                  result=tmp_path / "d.json")  # fmt: skip
    (found,) = said["findings"]
    assert (said["verdict"], found["effect"], found["target"]) == ("explained", "command_delay", "robot")
    assert set(found["joints"]) == set(SERVOS)
    assert set(said["parts"]) == set(SERVOS)


@pytest.mark.slow
@pytest.mark.parametrize("stiffness", [0.3, 3.0])
def test_a_late_bus_is_one_cause_where_one_joint_has_something_of_its_own_as_well(
    stiffness: float, tmp_path: Path
) -> None:
    """A spring a thirteenth as stiff as its servo, and one that is nearly as stiff and would drag the delay along."""
    own = EffectTerm(effect="spring", target="left", values={"stiffness": stiffness, "preload": 0.0})
    model, bag, other = changed_rig(tmp_path, "command_delay", {"delay": DELAY_S}, own, noise_rad=5e-4)
    said = called("diagnose", "--model", str(model), "--recording", str(bag), "--holdout", str(other),
                  result=tmp_path / "d.json")  # fmt: skip
    found = {one["effect"]: one for one in said["findings"]}
    assert set(found) == {"command_delay", "spring"}
    assert len(said["findings"]) == 2
    assert (found["command_delay"]["target"], found["spring"]["target"]) == (ROBOT, "left")
    assert set(found["command_delay"]["joints"]) == set(SERVOS)
    low, high = found["command_delay"]["parameters"]["delay"]["ci95"]
    assert low < DELAY_S < high


def test_a_look_at_the_whole_robot_alone_searches_no_group(tmp_path: Path) -> None:
    model, fit, other = changed_rig(tmp_path, "spring", {"stiffness": 0.5}, target="left")
    session = open_session(None, model)
    made = [align(session.twin, load_recording(bag)) for bag in (fit, other)]
    looked_at = diagnose(session.twin, made[:1], made[1:], most_effects=0)
    assert not looked_at.findings
    assert not looked_at.interrupted
    assert looked_at.parts["left"].times_floor > 10.0
    assert not looked_at.tried


@pytest.mark.slow
def test_a_weak_supply_is_one_cause_of_a_hand_whose_values_are_off_as_well(tmp_path: Path) -> None:
    """Each of its seven servos alone is at two thirds of its gain, give or take what the model is off by."""
    said = said_of_case(5158, tmp_path)
    assert said["verdict"] == "explained"
    assert [(one["effect"], one["target"]) for one in said["findings"]] == [("actuator_gain", ROBOT)]
    low, high = said["findings"][0]["parameters"]["factor"]["ci95"]
    assert low < 0.647 < high


@pytest.mark.slow
def test_a_light_load_that_each_joint_hides_in_its_values_is_found_at_the_arm(tmp_path: Path) -> None:
    """Each of three joints is at its floor with a weaker servo, more inertia and less damping."""
    said = said_of_case(5236, tmp_path)
    (found,) = said["findings"]
    assert (found["effect"], said["verdict"]) == ("payload", "explained")


@pytest.mark.slow
def test_friction_of_one_joint_is_not_taken_for_friction_of_all(tmp_path: Path) -> None:
    """One joint's dry friction is 20 sigma off, so that the mean of all is; the others do worse with it."""
    said = said_of_case(5244, tmp_path)
    assert [(one["effect"], one["target"]) for one in said["findings"]] == [("load_friction", "F1J2")]
