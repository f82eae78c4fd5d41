"""A model whose author wrote angles in degrees, as MuJoCo reads them by default, in rad like everything here."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np


def in_radians(spec: Any) -> None:
    """Converts the angles of an MjSpec that are still in its author's unit; the compiled model stays what it was."""
    if not spec.compiler.degree:
        return
    for joint in spec.joints:
        if joint.type in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_BALL):
            joint.range = np.radians(joint.range)
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
            joint.ref, joint.springref = np.radians(joint.ref), np.radians(joint.springref)
    placed = (spec.bodies, spec.geoms, spec.sites, spec.cameras, spec.frames)
    for orientation in (*(one.alt for some in placed for one in some), *(body.ialt for body in spec.bodies)):
        if orientation.type == mujoco.mjtOrientation.mjORIENTATION_EULER:
            orientation.euler = np.radians(orientation.euler)
        elif orientation.type == mujoco.mjtOrientation.mjORIENTATION_AXISANGLE:
            orientation.axisangle = [*orientation.axisangle[:3], np.radians(orientation.axisangle[3])]
    spec.compiler.degree = False
