"""Three servos side by side, quick to roll out, and a late bus that all of them share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from tests.simulation.made import Motion, recorded, saved
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.hand import load_hand
from twin_daemon.recordings.load import load_recording
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.submodel import drive_groups
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

SERVOS = ("left", "middle", "right")
DELAY_S = 0.03
FRICTION_N_M = 0.1

_LINK = """<body name="{0}_link" pos="0 {1} 0">
<joint name="{0}" axis="0 0 1" range="-1.5 1.5" damping="0.05" armature="0.004" frictionloss="0.01"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.2" contype="0" conaffinity="0"/></body>"""
_SERVO = '<position name="{0}" joint="{0}" kp="4" kv="0.15" ctrlrange="-1.5 1.5"/>'
_TIMES_S = [0.0, 0.4, 0.41, 1.2, 2.2, 2.5, 2.51, 3.2, 3.8, 4.4, 4.41, 5.5]
_SHARES = [0.0, 0.0, 0.6, 0.6, -0.5, -0.5, 0.1, 0.1, 0.3, 0.1, -0.3, -0.3]


def motion_of(servos: Sequence[str]) -> Motion:
    """All servos in motion, one a little after the other."""
    return {
        name: ([t + 0.1 * i for t in _TIMES_S], [(-1) ** i * share for share in _SHARES])
        for i, name in enumerate(servos)
    }


_MOTION = motion_of(SERVOS)


LAZY: Motion = {**_MOTION, "right": ([0.0, 6.0], [0.0, 0.1])}
"""The same motion but for one joint, which goes so slowly that a late command hardly shows at it."""


def rig_model(folder: Path, names: Sequence[str] = SERVOS) -> Path:
    """The MJCF of the rig."""
    path = folder / "rig.xml"
    links = "".join(_LINK.format(name, 0.5 * i) for i, name in enumerate(names))
    servos = "".join(map(_SERVO.format, names))
    path.write_text(
        f'<mujoco model="rig"><compiler angle="radian"/><option timestep="0.002"/><worldbody>{links}</worldbody>'
        f"<actuator>{servos}</actuator></mujoco>"
    )
    return path


def rubbing_rig(folder: Path) -> tuple[Path, Path]:
    """(the MJCF of a rig that states no dry friction, a bag of one whose left joint has it)."""
    model = rig_model(folder)
    model.write_text(model.read_text().replace(' frictionloss="0.01"', ""))
    rubs = EffectTerm(effect="coulomb_friction", target="left", values={"friction": FRICTION_N_M, "sticking": 0.0})
    plant = TwinModel.load(load_hand(model=model)).changed(Terms(effects=(rubs,)))
    made = recorded(plant, _MOTION, np.random.default_rng(5), seconds=6.0, noise_rad=3e-4)
    return model, saved(made, folder / "rubs.mcap")


def changed_rig(
    folder: Path,
    key: str,
    values: Mapping[str, float],
    *beside: EffectTerm,
    target: str = "robot",
    motion: Motion = _MOTION,
    noise_rad: float = 1e-4,
) -> tuple[Path, Path, Path]:
    """(the rig's MJCF, a bag of one with an effect at its target and others `beside` it, another with other noise).

    It has the servos that are in motion.
    """
    model = rig_model(folder, tuple(motion))
    twin = TwinModel.load(load_hand(model=model))
    plant = twin.changed(Terms(effects=(EffectTerm(effect=key, target=target, values=dict(values)), *beside)))
    made = [recorded(plant, motion, np.random.default_rng(seed), seconds=6.0, noise_rad=noise_rad) for seed in (6, 7)]
    fit, other = (saved(one, folder / f"{number}.mcap") for number, one in enumerate(made))
    return model, fit, other


def left_of_rig(folder: Path, key: str, values: Mapping[str, float]) -> Reduced:
    """The left joint of a rig whose recordings are of one with an effect there, which the model does not have."""
    model, bag, other = changed_rig(folder, key, values, target="left")
    twin = TwinModel.load(load_hand(model=model))
    train, held = ([align(twin, load_recording(path))] for path in (bag, other))
    group = next(group for group in drive_groups(twin) if "left" in group.joints)
    (reduced,) = Reduction(twin, train, held).each(twin, [(group, ["left"])])
    assert reduced is not None
    return reduced


def late_rig(folder: Path) -> tuple[Path, Path]:
    """(the rig's MJCF, a bag of it with a bus that is late for every servo)."""
    model = rig_model(folder)
    twin = TwinModel.load(load_hand(model=model))
    late = EffectTerm(effect="command_delay", target="robot", values={"delay": DELAY_S})
    plant = twin.changed(Terms(effects=(late,)))
    made = recorded(plant, _MOTION, np.random.default_rng(4), seconds=6.0, noise_rad=1e-3)
    return model, saved(made, folder / "late.mcap")
