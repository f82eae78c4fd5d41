"""A recording is cut where the part stands still, and what touches is left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.simulation.made import FINGER, Motion, recorded
from twin_daemon.comparison.split import hold_out
from twin_daemon.estimation.partition import Reduction
from twin_daemon.estimation.problem import Problem
from twin_daemon.estimation.windows import _piece, _Turning, length_s, segments
from twin_daemon.simulation.alignment import Aligned, align
from twin_daemon.simulation.contacts import touching_times
from twin_daemon.simulation.submodel import parts
from twin_daemon.simulation.terms import EffectTerm
from twin_daemon.simulation.twin import TwinModel

JOINTS = ("rh_FFJ1", "rh_FFJ2", "rh_FFJ3")


@pytest.fixture(scope="module")
def aligned(twin: TwinModel) -> Aligned:
    return align(twin, recorded(twin, FINGER, np.random.default_rng(0)))


def test_pieces_cover_the_whole_and_start_from_what_was_measured(aligned: Aligned) -> None:
    pieces = segments(aligned, JOINTS)
    assert len(pieces) >= 2
    assert length_s(pieces) == pytest.approx(float(aligned.time_s[-1]), abs=0.1 * len(pieces))
    for piece in pieces[1:]:
        begin = aligned.onset_s - piece.onset_s
        row = int(np.searchsorted(aligned.time_s, begin))
        columns = [aligned.joints.index(joint) for joint in JOINTS]
        np.testing.assert_allclose(piece.start_position[columns], aligned.measured[row, columns], atol=5e-3)
        assert np.isnan(piece.measured[0, columns]).all()  # not scored where the start was read


def test_a_piece_that_begins_in_a_swing_begins_where_the_joint_was(aligned: Aligned, rng: np.random.Generator) -> None:
    rate, size, noise = 30.0, 0.15, 5e-5
    turn = rate * aligned.time_s
    column = aligned.joints.index("rh_FFJ3")
    measured = aligned.measured.copy()
    measured[:, column] = 0.8 + size * np.sin(turn) + noise * rng.standard_normal(len(turn))
    pieces = segments(replace(aligned, measured=measured, unhidden=None), ("rh_FFJ3",))
    assert len(pieces) > 1
    for piece in pieces[1:]:
        begin = rate * (aligned.onset_s - piece.onset_s)
        assert piece.start_position[column] == pytest.approx(0.8 + size * np.sin(begin), abs=0.02 * size)
        assert piece.start_velocity[column] == pytest.approx(size * rate * np.cos(begin), abs=0.15 * size * rate)


@pytest.mark.parametrize("backwards", [False, True], ids=["sets off", "stops"])
def test_a_piece_that_begins_where_a_joint_sets_off_or_stops_begins_where_it_was(
    aligned: Aligned, rng: np.random.Generator, backwards: bool
) -> None:
    """A fast servo reaches its speed within a sample: no line or cubic through those around it is right."""
    speed, noise, column = 2.0, 5e-5, aligned.joints.index("rh_FFJ3")
    # rests and strokes in turn, so that each piece begins within some samples of a corner
    turn = np.mod(aligned.time_s, 1.5)
    stroke = np.clip(turn - 0.7, 0.0, 0.2)
    where = speed * (stroke if (not backwards) else 0.2 - np.clip(turn - 0.02, 0.0, 0.2))
    measured = aligned.measured.copy()
    measured[:, column] = 0.5 + where + noise * rng.standard_normal(len(where))
    true = replace(aligned, measured=measured, unhidden=None)
    width, turns = (
        round(0.12 / float(np.median(np.diff(aligned.time_s)))),
        _Turning(true, np.full(len(true.joints), 1e-3)),
    )
    corner = int(np.argmax(turn > (0.7 if not backwards else 0.22)))
    for index in (corner - 1, corner, corner + 1):
        piece = _piece(true, index, len(where), width, turns)
        assert piece.start_position[column] == pytest.approx(measured[index, column], abs=6 * noise)
        assert min(abs(abs(piece.start_velocity[column]) - known) for known in (0.0, speed)) < 0.02


def test_a_slow_joint_with_a_fine_sensor_does_not_stand_still(aligned: Aligned, rng: np.random.Generator) -> None:
    """A slide of some centimetres: what is slow for a finger is its whole motion."""
    rate, size, noise, column = 1.5, 0.02, 3e-5, aligned.joints.index("rh_FFJ3")
    measured = aligned.measured.copy()
    measured[:, column] = size * np.sin(rate * aligned.time_s) + noise * rng.standard_normal(len(measured))
    pieces = segments(replace(aligned, measured=measured, unhidden=None), ("rh_FFJ3",))
    assert len(pieces) > 1
    for piece in pieces[1:]:
        begin = rate * (aligned.onset_s - piece.onset_s)
        assert piece.start_velocity[column] == pytest.approx(size * rate * np.cos(begin), abs=0.05 * size * rate)


def test_a_piece_remembers_what_the_motion_before_it_has_bent(twin: TwinModel, rng: np.random.Generator) -> None:
    """Slow reversals of a joint with a soft hysteresis: nowhere it stands still, and nowhere it is bent to the end."""
    noise_rad = 5e-5
    term = EffectTerm(effect="hysteresis", target="rh_FFJ3", values={"torque": 0.1, "stiffness": 0.5})
    bent = twin.changed(twin.terms.with_effect(term))
    time_s = np.arange(0.0, 8.0, 0.25)
    motion: Motion = {"rh_FFJ3": (time_s.tolist(), (0.7 + 0.35 * np.sin(1.9 * time_s)).tolist())}
    recording = align(bent, recorded(bent, motion, rng, seconds=7.5, noise_rad=noise_rad))
    pieces = segments(recording, ("rh_FFJ3",))[1:]  # what was before the first nobody knows
    assert pieces
    problem = Problem(bent, pieces, (), ("rh_FFJ3",))
    for residual in problem.joint_residuals(problem.start[None]):
        assert np.sqrt((residual**2).mean()) < 1.2 * noise_rad


def test_a_piece_remembers_a_set_point_that_has_been_on_its_way_all_along(
    twin: TwinModel, rng: np.random.Generator
) -> None:
    """One step that a slow limit of rate needs ten seconds for."""
    noise_rad = 5e-5
    slow = twin.changed(twin.terms.with_effect(EffectTerm(effect="rate_limit", target="rh_FFJ3", values={"rate": 0.1})))
    motion: Motion = {"rh_FFJ3": ([0.0, 0.5, 0.6, 11.0], [0.2, 0.2, 1.3, 1.3])}
    recording = align(slow, recorded(slow, motion, rng, seconds=10.5, noise_rad=noise_rad))
    pieces = segments(recording, ("rh_FFJ3",))
    assert len(pieces) > 2
    problem = Problem(slow, pieces, (), ("rh_FFJ3",))
    for residual in problem.joint_residuals(problem.start[None]):
        assert np.sqrt((residual**2).mean()) < 2.0 * noise_rad


def test_time_in_contact_is_in_no_piece(aligned: Aligned) -> None:
    touching = (aligned.time_s > 2.0) & (aligned.time_s < 2.5)
    for piece in segments(aligned, JOINTS, touching):
        begin = aligned.onset_s - piece.onset_s
        times = begin + piece.time_s
        assert not ((times > 2.0) & (times < 2.5)).any()


def test_what_is_held_out_still_says_where_the_hand_was(aligned: Aligned) -> None:
    whole = {_begin(aligned, piece): piece for piece in segments(aligned, JOINTS)}
    hidden = [np.isnan(half[0].measured).all(axis=1) for half in hold_out([aligned])]
    for half, gone in zip(hold_out([aligned]), hidden, strict=True):
        pieces = segments(half[0], JOINTS)
        assert pieces
        for piece in pieces:
            begin = _begin(aligned, piece)
            np.testing.assert_array_equal(piece.start_position, whole[begin].start_position)
            rows = np.searchsorted(aligned.time_s, begin + piece.time_s - 1e-9)
            assert np.isnan(piece.measured[gone[rows]]).all()
            assert np.isfinite(piece.measured).any()


def _begin(aligned: Aligned, piece: Aligned) -> float:
    return round(aligned.onset_s - piece.onset_s, 9)


def test_fingers_that_are_pushed_together_touch(twin: TwinModel) -> None:
    pose = np.zeros((2, len(twin.joints)))
    pose[1, twin.joints.index("rh_FFJ4")] = 0.349
    pose[1, twin.joints.index("rh_MFJ4")] = -0.349
    masks = touching_times(twin, parts(twin), pose, 1e-3)
    for finger in ("FF", "MF"):
        near, touched = masks[finger]
        assert near.tolist() == touched.tolist() == [False, True]
    assert not any(mask.any() for mask in masks["thumb"])


def test_fingers_that_pass_each_other_are_near_and_touch_only_while_one_of_the_poses_does(twin: TwinModel) -> None:
    towards = np.linspace(0.0, 0.349, 200)
    pose = np.zeros((len(towards), len(twin.joints)))
    pose[:, twin.joints.index("rh_FFJ4")] = towards
    pose[:, twin.joints.index("rh_MFJ4")] = -towards
    near, touched = touching_times(twin, parts(twin), pose, 1e-3)["FF"]
    first = int(np.argmax(near))
    assert 0 < first < len(towards)
    assert near[first:].all()
    assert (touched == near).all()  # a run of poses with a touch in it is one
    apart = first + int(0.5 * (np.argmax(touching_times(twin, parts(twin), pose, 1e-6)["FF"][0]) - first))
    near, touched = touching_times(twin, parts(twin), pose[: apart + 1], 1e-3)["FF"]
    assert near[apart]
    assert not touched.any()


def test_motion_in_which_fingers_only_pass_each_other_is_left_out_at_first(twin: TwinModel) -> None:
    together = np.zeros((200, len(twin.joints)))
    together[:, twin.joints.index("rh_FFJ4")] = np.linspace(0.0, 0.349, len(together))
    together[:, twin.joints.index("rh_MFJ4")] = -together[:, twin.joints.index("rh_FFJ4")]
    found = [touching_times(twin, parts(twin), together, margin_m)["FF"][0] for margin_m in (1e-3, 1e-6)]
    near, touch = (together[np.argmax(mask), twin.joints.index("rh_FFJ4")] for mask in found)
    angle = 0.5 * float(near + touch)
    moves: Motion = {
        finger: ([0.0, 0.5, 1.5, 4.0, 5.0], [0.0, 0.0, sign * angle, sign * angle, 0.0])
        for finger, sign in (("rh_FFJ4", 1.0), ("rh_MFJ4", -1.0))
    }
    reduction = Reduction(twin, [align(twin, recorded(twin, moves, np.random.default_rng(0)))], [])
    assert reduction.clear_s(["rh_FFJ4"]) < 4.0
    assert reduction.where_near().clear_s(["rh_FFJ4"]) > 5.0
