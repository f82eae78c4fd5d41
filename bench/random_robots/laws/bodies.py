"""The machine itself: rotor inertia, something that is carried, a base that stands askew."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..dice import chance
from .base import Law, change


class Armature(Law):
    """More rotor inertia, or less of the model's own; the size is in parts of the inertia that the servo moves."""

    key = "armature"
    sizes = (2e-3, 6.0)

    def draw(self, random: np.random.Generator) -> None:
        own = float(self.site.robot.armature[self.site.joint])
        self._less = chance(random, 0.3) and own > 0.3 * self.site.inertia

    def values(self) -> dict[str, float]:
        if self._less:
            return {"armature": -0.95 * float(self.site.robot.armature[self.site.joint]) * (1 - np.exp(-self.size))}
        return {"armature": self.size * self.site.inertia}

    def nominal_change(self) -> float | None:
        return change(float(self.site.robot.armature[self.site.joint]), self.values()["armature"])

    def edit(self, spec: Any) -> None:
        joint = self.joint_of(spec)
        joint.armature = joint.armature + self.values()["armature"]


class Payload(Law):
    """A small heavy thing fixed near the far end of the joint's link."""

    key = "payload"
    sizes = (1e-3, 5.0)

    def draw(self, random: np.random.Generator) -> None:
        link = self.site.robot.tree.links[self.site.joint]
        self._at = np.asarray(link.tip) * float(random.uniform(0.85, 1.0))
        carried = sum(other.mass for other in self.site.robot.tree.links[self.site.joint :])
        self._unit = max(link.mass, 0.3 * carried)

    def values(self) -> dict[str, float]:
        return {"mass": self.size * self._unit}

    def edit(self, spec: Any) -> None:
        mass = self.size * self._unit
        body = spec.body(f"{self.site.robot.joints[self.site.joint]}_link").add_body(name="carried", pos=self._at)
        body.explicitinertial = True
        body.mass, body.ipos = mass, np.zeros(3)
        body.inertia = np.full(3, max(mass * (0.05 * float(np.linalg.norm(self._at))) ** 2, 1e-10))

    @property
    def places(self) -> tuple[str, ...]:
        """The joint and its neighbours in the chain: a load at a link's end is one at the next link's beginning."""
        tree, joint = self.site.robot.tree, self.site.joint
        near = [i for i in tree.chain(joint) if tree.links[i].parent == joint or i in (joint, tree.links[joint].parent)]
        return tuple(self.site.robot.joints[index] for index in near)


class Tilt(Law):
    """The base stands askew: gravity is turned about a level axis."""

    key = "gravity_tilt"
    at = "robot"
    sizes = (1e-3, 1.2)

    def draw(self, random: np.random.Generator) -> None:
        self._azimuth = float(random.uniform(-np.pi, np.pi))

    def edit(self, spec: Any) -> None:
        pull, lean = 9.81, self.size
        level = np.array([np.cos(self._azimuth), np.sin(self._azimuth)]) * np.sin(lean)
        spec.option.gravity = [pull * level[0], pull * level[1], -pull * np.cos(lean)]

    @property
    def places(self) -> tuple[str, ...]:
        return self.site.robot.joints
