"""The hand in space: where its points are, and which joints turn which line."""

from __future__ import annotations

import mujoco
import numpy as np

from twin_daemon.hand import load_hand
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.web.skeleton import Skeleton


def test_a_joint_moves_what_hangs_on_it_and_turns_its_bone() -> None:
    twin = TwinModel.load(load_hand())
    skeleton = Skeleton(twin)
    bent = np.full(len(twin.joints), 0.4)  # where no bone lies on the axis that turns it
    rest = skeleton.points(bent)
    assert np.isfinite(rest).all()
    for name in ("rh_FFJ3", "rh_THJ5", "rh_WRJ1"):
        column = twin.joints.index(name)
        angles = bent.copy()
        angles[column] += 0.3
        moved = np.linalg.norm(skeleton.points(angles) - rest, axis=1) > 1e-4
        turned = [bone for bone in skeleton.bones if column in bone.joints]
        assert turned
        assert all(moved[bone.end] for bone in turned)
        lengths = [np.linalg.norm(p[b.end] - p[b.start]) for p in (rest, skeleton.points(angles)) for b in turned]
        assert np.allclose(lengths[: len(turned)], lengths[len(turned) :])
    assert moved.sum() > 20  # the wrist carries all fingers
    assert not moved[mujoco.mj_name2id(twin.model, mujoco.mjtObj.mjOBJ_BODY, "world")]


def test_every_joint_is_to_be_seen() -> None:
    twin = TwinModel.load(load_hand())
    assert {joint for bone in Skeleton(twin).bones for joint in bone.joints} == set(range(len(twin.joints)))


def test_what_is_not_known_stands_at_zero() -> None:
    twin = TwinModel.load(load_hand())
    skeleton = Skeleton(twin)
    unknown = skeleton.points(np.full(len(twin.joints), np.nan))
    assert np.allclose(unknown, skeleton.points(np.zeros(len(twin.joints))))
