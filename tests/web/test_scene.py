"""The hand in space: what there is to be seen, where it is, and which joints turn it."""

from __future__ import annotations

import base64
from pathlib import Path

import mujoco
import numpy as np

from twin_daemon.hand import load_hand
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.web.scene import Scene

MESHED = """<mujoco><asset><mesh name="wedge" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>
<worldbody><geom type="plane" size="1 1 1"/><body><joint name="elbow" range="-1 1"/>
<geom type="mesh" mesh="wedge"/><geom type="capsule" size=".1 .2" rgba="0 0 0 0"/></body></worldbody>
<actuator><position name="elbow" joint="elbow" kp="1" ctrlrange="-1 1"/></actuator></mujoco>"""


def test_a_joint_moves_what_hangs_on_it_and_turns_its_body() -> None:
    twin = TwinModel.load(load_hand())
    scene = Scene(twin)
    bent = np.full(len(twin.joints), 0.4)
    rest = scene.poses(bent)
    assert rest.shape == (twin.model.nbody, 7)
    assert np.isfinite(rest).all()
    assert np.allclose(np.linalg.norm(rest[:, 3:], axis=1), 1.0)
    moved = np.zeros(twin.model.nbody, bool)
    for name in ("rh_FFJ3", "rh_THJ5", "rh_WRJ1"):
        column = twin.joints.index(name)
        angles = bent.copy()
        angles[column] += 0.3
        moved = np.abs(scene.poses(angles) - rest).max(axis=1) > 1e-4
        turned = [body for body, columns in enumerate(scene.joints) if column in columns]
        assert turned
        assert moved[turned].all()
    assert moved.sum() > 20  # the wrist carries all fingers
    assert not moved[mujoco.mj_name2id(twin.model, mujoco.mjtObj.mjOBJ_BODY, "world")]


def test_every_joint_is_to_be_seen_and_every_shape_is_whole() -> None:
    twin = TwinModel.load(load_hand())
    scene = Scene(twin)
    described = scene.described()
    seen = {column for geom in described["geoms"] for column in described["joints"][geom["body"]]}
    assert seen == set(range(len(twin.joints)))
    for geom in described["geoms"]:
        assert geom["shape"] in {"sphere", "capsule", "cylinder", "box", "ellipsoid", "mesh"}
        assert len(geom["size"]) == len(geom["position"]) == 3
        assert np.isclose(np.linalg.norm(geom["quaternion"]), 1.0)


def test_meshes_come_with_their_triangles_and_what_is_not_seen_does_not(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(MESHED)
    twin = TwinModel.load(load_hand(model=tmp_path / "arm.xml"))
    described = Scene(twin).described()
    (geom,) = described["geoms"]  # neither the floor nor what is transparent
    assert geom["shape"] == "mesh"
    (mesh,) = described["meshes"].values()
    points = np.frombuffer(base64.b64decode(mesh["points"]), "<f4").reshape(-1, 3)
    faces = np.frombuffer(base64.b64decode(mesh["faces"]), "<u4").reshape(-1, 3)
    assert len(points) >= 4
    assert faces.max() < len(points)


def test_what_is_not_known_stands_at_zero() -> None:
    twin = TwinModel.load(load_hand())
    scene = Scene(twin)
    unknown = scene.poses(np.full(len(twin.joints), np.nan))
    assert np.allclose(unknown, scene.poses(np.zeros(len(twin.joints))))
