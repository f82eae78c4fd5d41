"""Kinematic trees: single fingers, hands with wrists, serial arms, gantries. Lengths in m, masses in kg, angles in rad.

Links lie along their own x axis; a flexion turns about y. Masses shrink towards the tip.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .dice import chance, log_uniform, pick

KINDS = ("finger", "hand", "arm", "gantry")

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Link:
    """A rigid body and the joint that carries it. `parent` is an index among the links, -1 the base."""

    joint: str
    parent: int
    position: Vector  # m, in the parent's frame
    axis: Vector
    low: float  # rad, or m of a slide
    high: float
    mass: float  # kg
    centre: Vector  # m, of mass
    inertia: Vector  # kg m2, about the centre of mass, along the link's own axes
    tip: Vector  # m, where the next link begins or the link ends
    radius: float  # m, of the capsule that is drawn
    slide: bool = False


@dataclass(frozen=True)
class Tree:
    """All links, parents first. `pairs` holds (command, proximal, distal): one tendon pulls the sum of two joints."""

    kind: str
    links: tuple[Link, ...]
    pairs: tuple[tuple[str, int, int], ...]
    base: tuple[float, float, float, float]  # quaternion w, x, y, z of the base

    def chain(self, index: int) -> tuple[int, ...]:
        """The link, those that carry it up to the last branching, and those that it alone carries."""
        children: dict[int, list[int]] = {}
        for number, link in enumerate(self.links):
            children.setdefault(link.parent, []).append(number)
        out, at = [index], self.links[index].parent
        while at >= 0 and len(children[at]) == 1:
            out.append(at)
            at = self.links[at].parent
        at = index
        while len(children.get(at, [])) == 1:
            at = children[at][0]
            out.append(at)
        return tuple(sorted(out))


def draw_tree(random: np.random.Generator, kind: str, pair: bool | None = None) -> Tree:
    """A tree of the kind; `pair` asks for a coupled tendon, True or False, where the kind may have one."""
    return {"finger": _finger_robot, "hand": _hand, "arm": _arm, "gantry": _gantry}[kind](random, pair)


def _rod(
    random: np.random.Generator, joint: str, parent: int, position: Vector, axis: Vector, ends: tuple[float, float],
    length: float, mass: float,
) -> Link:  # fmt: skip
    """A round rod along x whose mass is not quite in its middle."""
    radius = length * float(random.uniform(0.1, 0.25))
    centre = length * float(random.uniform(0.35, 0.6))
    across = mass * (3 * radius**2 + length**2) / 12
    inertia = (mass * radius**2 / 2, across, across)
    middle = (centre, 0.0, radius * float(random.uniform(-0.15, 0.15)))
    return Link(joint, parent, position, axis, *ends, mass, middle, inertia, (length, 0.0, 0.0), radius)


def _finger(
    random: np.random.Generator, name: str, parent: int, root: Vector, first: int, scale: float, mass: float,
    bends: int, spreads: bool, pair: bool,
) -> tuple[list[Link], list[tuple[str, int, int]]]:  # fmt: skip
    """A finger of `bends` flexions, perhaps spread by a first joint; the last two may hang on one tendon (J1 + J2)."""
    links: list[Link] = []
    lengths = scale * random.uniform(0.7, 1.0, bends) * 0.85 ** np.arange(bends)
    masses = mass * random.uniform(0.7, 1.3, bends) * 0.7 ** np.arange(bends)
    at, where = parent, root
    if spreads:
        knuckle = _rod(random, f"{name}J{bends + 1}", at, where, (0, 0, 1), (-0.35, 0.35), 0.3 * scale, 0.4 * mass)
        links.append(knuckle)
        at, where = first, (0.0, 0.0, 0.0)
    for number in range(bends):
        coupled = pair and number >= bends - 2
        ends = (0.0, 1.57) if coupled else (-0.26, float(random.uniform(1.2, 1.57)))
        joint = f"{name}J{bends - number}"
        links.append(_rod(random, joint, at, where, (0, 1, 0), ends, float(lengths[number]), float(masses[number])))
        at, where = first + len(links) - 1, (float(lengths[number]), 0.0, 0.0)
    last = first + len(links) - 1
    return links, [(f"{name}J0", last - 1, last)] if pair else []


def _finger_robot(random: np.random.Generator, pair: bool | None) -> Tree:
    coupled = chance(random, 0.35) if pair is None else pair
    bends = int(random.integers(2 + coupled, 4))
    scale, mass = log_uniform(random, 0.02, 0.06), log_uniform(random, 0.004, 0.06)
    links, pairs = _finger(random, "F1", -1, (0, 0, 0.1), 0, scale, mass, bends, chance(random, 0.5), coupled)
    return Tree("finger", tuple(links), tuple(pairs), _mounting(random))


def _hand(random: np.random.Generator, pair: bool | None) -> Tree:
    coupled = chance(random, 0.6) if pair is None else pair
    scale, mass = log_uniform(random, 0.025, 0.05), log_uniform(random, 0.006, 0.05)
    links: list[Link] = []
    at, where = -1, (0.0, 0.0, 0.2)
    for number, axis in enumerate(((0, 1, 0), (0, 0, 1))[: pick(random, (0, 1, 1, 2))]):
        palm = mass * float(random.uniform(4, 10))
        swing = float(random.uniform(0.4, 0.8))
        links.append(_rod(random, f"WRJ{2 - number}", at, where, axis, (-swing, swing), 2 * scale, palm))
        at, where = len(links) - 1, (0.3 * scale, 0.0, 0.0)
    fingers = int(random.integers(2, 4 if coupled else 5))
    bends, spreads = (3 if coupled else 2), chance(random, 0.4)
    pairs = []
    for number in range(fingers):
        root = (2 * scale, (number - (fingers - 1) / 2) * scale, 0.0 if at >= 0 else 0.2)
        grown, tied = _finger(
            random, f"F{number + 1}", at, root, len(links), scale, mass, bends, spreads, coupled
        )  # fmt: skip
        links += grown
        pairs += tied
    return Tree("hand", tuple(links), tuple(pairs), _mounting(random))


# name, axis, lowest and highest angle, share of the reach
_ARMS: dict[int, tuple[tuple[str, Vector, float, float, float], ...]] = {
    3: (("pan", (0, 0, 1), -2.2, 2.2, 0.1), ("lift", (0, 1, 0), -1.9, 0.5, 0.5), ("elbow", (0, 1, 0), -0.3, 2.2, 0.4)),
    4: (("pan", (0, 0, 1), -2.2, 2.2, 0.1), ("lift", (0, 1, 0), -1.9, 0.5, 0.4), ("elbow", (0, 1, 0), -0.3, 2.2, 0.35),
        ("wrist", (0, 1, 0), -1.6, 1.6, 0.15)),
    5: (("pan", (0, 0, 1), -2.2, 2.2, 0.1), ("lift", (0, 1, 0), -1.9, 0.5, 0.4), ("elbow", (0, 1, 0), -0.3, 2.2, 0.3),
        ("wrist_flex", (0, 1, 0), -1.6, 1.6, 0.12), ("wrist_roll", (1, 0, 0), -2.0, 2.0, 0.08)),
    6: (("pan", (0, 0, 1), -2.2, 2.2, 0.1), ("lift", (0, 1, 0), -1.9, 0.5, 0.4), ("elbow", (0, 1, 0), -0.3, 2.2, 0.3),
        ("wrist_1", (0, 1, 0), -1.8, 1.8, 0.08), ("wrist_2", (0, 0, 1), -1.8, 1.8, 0.07),
        ("wrist_3", (1, 0, 0), -2.5, 2.5, 0.05)),
    7: (("joint_1", (0, 0, 1), -2.2, 2.2, 0.1), ("joint_2", (0, 1, 0), -1.9, 0.5, 0.2),
        ("joint_3", (1, 0, 0), -1.5, 1.5, 0.2), ("joint_4", (0, 1, 0), -0.3, 2.2, 0.2),
        ("joint_5", (1, 0, 0), -2.0, 2.0, 0.15), ("joint_6", (0, 1, 0), -1.6, 1.6, 0.1),
        ("joint_7", (1, 0, 0), -2.5, 2.5, 0.05)),
}  # fmt: skip


def _arm(random: np.random.Generator, pair: bool | None) -> Tree:
    total = log_uniform(random, 0.3, 50.0)
    reach = 0.33 * total ** (1 / 3) * float(random.uniform(0.8, 1.2))
    parts = _ARMS[int(random.integers(3, 8))]
    shares = np.array([part[4] for part in parts]) ** 0.7 * random.uniform(0.7, 1.4, len(parts))
    shares *= 0.85 ** np.arange(len(parts))
    shares /= shares.sum()
    links: list[Link] = []
    where: Vector = (0.0, 0.0, 0.3 * reach)
    for number, (name, axis, low, high, share) in enumerate(parts):
        length, mass = share * reach, float(shares[number] * total)
        links.append(_rod(random, name, number - 1, where, axis, (low, high), length, mass))
        where = (length, 0.0, 0.0)
    return Tree("arm", tuple(links), (), (1.0, 0.0, 0.0, 0.0))


def _gantry(random: np.random.Generator, pair: bool | None) -> Tree:
    total = log_uniform(random, 0.5, 50.0)
    travel = 0.25 * total ** (1 / 3) * float(random.uniform(0.7, 1.3))
    slides = ("x", "y", "z") if chance(random, 0.7) else ("x", "z")
    axes = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
    turns = (("swivel", (0, 0, 1), -2.5, 2.5), ("tilt", (0, 1, 0), -1.2, 1.2))[: int(random.integers(0, 3))]
    links: list[Link] = []
    where: Vector = (0.0, 0.0, 2 * travel)
    left = total
    for name in slides:
        mass = left * float(random.uniform(0.4, 0.6))
        left -= mass
        half = travel / 2 * float(random.uniform(0.6, 1.0))
        size = 0.3 * travel
        inertia = (mass * size**2 / 6,) * 3
        centre = tuple(size * float(v) for v in random.uniform(-0.2, 0.2, 3))
        carried = (0.2 * size, 0.0, -0.3 * size)
        links.append(
            Link(f"slide_{name}", len(links) - 1, where, axes[name], -half, half, mass, centre, inertia, carried,
                 0.2 * size, True)
        )  # fmt: skip
        where = carried
    for name, axis, low, high in turns:
        mass = left * float(random.uniform(0.3, 0.6))
        left -= mass
        links.append(_rod(random, name, len(links) - 1, where, axis, (low, high), 0.25 * travel, mass))
        where = (0.25 * travel, 0.0, 0.0)
    return Tree("gantry", tuple(links), (), (1.0, 0.0, 0.0, 0.0))


def _mounting(random: np.random.Generator) -> tuple[float, float, float, float]:
    """Upright, lying or hanging, and a little askew: a quaternion."""
    about = pick(random, (0.0, -np.pi / 2, np.pi / 2, np.pi)) + float(random.uniform(-0.3, 0.3))
    return (float(np.cos(about / 2)), 0.0, float(np.sin(about / 2)), 0.0)
