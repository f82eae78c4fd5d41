"""An effect that was found first and does nothing beside a later one is no finding."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.diagnosis.rig import changed_rig, motion_of
from twin_daemon.diagnosis.candidates import candidate
from twin_daemon.diagnosis.conclude import Accepted
from twin_daemon.diagnosis.group import look
from twin_daemon.diagnosis.limits import fitted_at
from twin_daemon.diagnosis.rivals import without_idle
from twin_daemon.diagnosis.thresholds import FULL_FIT_ROLLOUTS
from twin_daemon.diagnosis.validation import Validation
from twin_daemon.effects import LIBRARY
from twin_daemon.estimation.partition import Reduction
from twin_daemon.recordings.load import load_recording
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.submodel import drive_groups
from twin_daemon.workflows.session import open_session

CUBIC = {"cubic": 20.0, "centre": 0.2}


def test_what_does_nothing_beside_the_right_law_is_dropped(tmp_path: Path) -> None:
    model, *bags = changed_rig(tmp_path, "nonlinear_spring", CUBIC, target="left", motion=motion_of(["left"]))
    session = open_session(None, model)
    fitted, held = ([align(session.twin, load_recording(bag))] for bag in bags)
    (group,) = drive_groups(session.twin)
    (cut,) = Reduction(session.twin, fitted, held).each(session.twin, [(group, ["left"])])
    assert cut is not None
    reduced, part = look(cut)
    validation = Validation(part, reduced.holdout, seed=0)
    right = fitted_at(part, candidate(LIBRARY["nonlinear_spring"], "left", part.twin, "left"), CUBIC, {})
    hypothesis = candidate(LIBRARY["spring"], "left", part.twin, "left")
    wrong = fitted_at(part, hypothesis, hypothesis.starts[0], {})
    accepted = [Accepted(part, fit, validation.judge(fit)) for fit in part.together([wrong, right], FULL_FIT_ROLLOUTS)]
    found, idle = without_idle(part, validation, accepted, FULL_FIT_ROLLOUTS)
    assert [one.hypothesis.name for one in found] == ["nonlinear_spring:left"]
    # by the servo's strength, which nothing here tells: all torques may be greater together
    strength = found[0].fit.moved["left.kp"] / part.twin.scale("left").kp
    assert found[0].fit.values["cubic"] / strength == pytest.approx(CUBIC["cubic"], rel=0.02)
    assert found[0].judged.adequate
    (trial,) = idle
    assert trial.effect == "spring"
    assert "nonlinear_spring:left" in trial.lost_because
    # the law that is right explains more alone than the wrong one does: it is not in the place of that beside itself
    known = {"spring:left": 100.0, "nonlinear_spring:left": 5000.0, "payload:left": 10.0}
    first, second = (replace(one, weighed=known, rivals=()) for one in accepted)
    assert first.posterior()["spring:left"] < 0.01
    assert first.posterior([second])["spring:left"] > 0.99
