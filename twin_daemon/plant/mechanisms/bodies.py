"""Inertia and gravity: changes of the machine itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np

from .base import AtPorts, Mechanism, Placed

if TYPE_CHECKING:
    from ..rig import Rig

_LOAD = "hidden_load_"


class Armature(AtPorts):
    """Rotor or gear inertia that the nominal model does not know, at the joint or along the tendon."""

    stages = ()

    def prepare(self) -> None:
        super().prepare()
        self._given = np.zeros(len(self.names))
        self._tendons = self.rig.model.actuator_trnid[self.rig.actuator_of[self.ports.command], 0]

    def update(self) -> None:
        added = self.ordered(self.value) - self._given
        self._given += added
        self.rig.model.dof_armature[self.ports.dof] += added[: self.ports.split]
        if self._tendons.size:
            self.rig.model.tendon_armature[self._tendons] += added[self.ports.split :]
        self.rig.refresh()


class Payload(Mechanism):
    """A small ball fixed to the end of the link that the joint moves."""

    @classmethod
    def edit_spec(cls, spec: mujoco.MjSpec, rig: Rig, placed: list[Placed]) -> None:
        for one in placed:
            body = rig.link_of(one.name)
            end = 2.0 * rig.model.body_ipos[body]  # a link's centre of mass is about half way to its end
            load = spec.body(rig.model.body(body).name).add_body(name=_LOAD + one.name, pos=end)
            load.mass, load.inertia, load.ipos, load.explicitinertial = 1e-9, [1e-15] * 3, [0.0, 0.0, 0.0], True

    def update(self) -> None:
        model = self.rig.model
        for name, mass in zip(self.names, self.value, strict=True):
            body = model.body(_LOAD + name).id
            model.body_mass[body] = mass
            model.body_inertia[body] = 0.4 * mass * 0.005**2  # a ball of 5 mm radius
        self.rig.refresh()


class GravityTilt(Mechanism):
    """The hand is mounted crooked: gravity turned by `value` rad about the horizontal axis at `azimuth` rad from x."""

    def prepare(self) -> None:
        self._gravity = self.rig.model.opt.gravity.copy()

    def update(self) -> None:
        gravity = self._gravity
        for angle, azimuth in zip(self.value, self.more["azimuth"], strict=True):
            axis = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
            across = np.cross(axis, gravity)
            along = axis * (axis @ gravity) * (1.0 - np.cos(angle))
            gravity = gravity * np.cos(angle) + across * np.sin(angle) + along  # Rodrigues
        self.rig.model.opt.gravity[:] = gravity
