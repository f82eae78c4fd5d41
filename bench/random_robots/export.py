"""Writes cases as others can use them: ROS 2 bags, the nominal MJCF, the sealed truth and a scorer of one file.

The format is explained in docs/suite-format.md.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from . import score
from .cases import Case, Recording
from .ties import ties

_EPOCH_S = 1_700_000_000
_TRANSPORT_NS = 300_000  # how much later than its stamp a state is written
SEAL = "SEALED.sha256"


def export(case: Case, folder: Path) -> None:
    """Writes the case into the folder: model, two bags, truth, and the scorer beside them."""
    folder.mkdir(parents=True, exist_ok=True)
    name = case.plan.name
    (folder / f"{name}.xml").write_text(case.robot.xml)
    for kind in ("fit", "holdout"):
        path = folder / f"{name}_{kind}"
        shutil.rmtree(path, ignore_errors=True)
        write_bag(path, case.recording(kind), case.robot.joints, case.robot.commands)
    (folder / f"{name}.truth.json").write_text(json.dumps(truth(case), indent=1) + "\n")
    shutil.copy(score.__file__, folder / "score.py")
    seal(folder)


def seal(folder: Path) -> None:
    """Writes the digests of all truths: who publishes them beforehand cannot change a truth afterwards."""
    lines = [f"{hashlib.sha256(p.read_bytes()).hexdigest()}  {p.name}" for p in sorted(folder.glob("*.truth.json"))]
    (folder / SEAL).write_text("\n".join(lines) + "\n")


def truth(case: Case) -> dict[str, Any]:
    """What is hidden, as one JSON object; `right` and `joints` as the practice cases have them."""
    effects = [
        {
            "effect": hidden.law.key, "joints": list(hidden.law.places),
            "scope": "robot" if hidden.law.at == "robot" else "joint", "strength": round(hidden.strength, 4),
            "over_sensors": round(hidden.over_sensors, 4), "ties": ties(hidden.law, hidden.strength),
            "parameters": {key: float(f"{value:.9g}") for key, value in hidden.law.values().items()},
        }
        for hidden in case.hidden
    ]  # fmt: skip
    named = case.plan.kind in ("single", "robot")
    robot = case.robot
    return {
        "schema": 1,
        "case": case.plan.name,
        "seed": case.plan.seed,
        "half": case.plan.half,
        "kind": case.plan.kind,
        "model": f"{case.plan.name}.xml",
        "right": [effects[0]["effect"], *effects[0]["ties"]] if named else [],
        "composed": [list(names) for hidden in case.hidden for names in hidden.law.composed],
        "joints": effects[0]["joints"] if effects else [],
        "strength": effects[0]["strength"] if effects else None,
        "effects": effects,
        "robot": {
            "kind": robot.tree.kind, "joints": len(robot.joints), "mass_kg": sum(k.mass for k in robot.tree.links),
            "rate_hz": robot.rate_hz, "noise_rad": [float(v) for v in robot.noise],
            "resolution_rad": [float(v) for v in robot.resolution], "jitter_s": robot.jitter_s,
            "delay_s": robot.delay_s, "model_error": case.error, "plant_step_s": case.plant.clock.step_s,
        },
    }  # fmt: skip


def write_bag(
    path: Path, recording: Recording, joints: Sequence[str], commands: Sequence[str], *, began_s: int = _EPOCH_S
) -> None:
    """A ROS 2 bag (MCAP): sensor_msgs/JointState on /joint_states and, as position targets, on /joint_commands.

    The recording's times count from `began_s`, in seconds since 1970.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    types: Any = store.types
    state, header, time = (types[name] for name in _MESSAGES)
    empty = np.zeros(0)

    def message(stamp_ns: int, names: list[str], values: np.ndarray) -> Any:
        stamp = time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        said = state(header=header(stamp=stamp, frame_id=""), name=names, position=values, velocity=empty, effort=empty)
        return store.serialize_cdr(said, state.__msgtype__)

    rows = []
    for sent, target in zip(recording.sent_s, recording.targets, strict=True):
        stamp_ns = began_s * 10**9 + round(sent * 1e9)
        rows.append((stamp_ns, 0, message(stamp_ns, list(commands), target)))
    for stamp, reading in zip(recording.stamps_s, recording.readings, strict=True):
        stamp_ns = began_s * 10**9 + round(stamp * 1e9)
        rows.append((stamp_ns + _TRANSPORT_NS, 1, message(stamp_ns, list(joints), reading)))
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = [writer.add_connection(name, state.__msgtype__, typestore=store) for name in _TOPICS]
        for written_ns, which, payload in sorted(rows, key=lambda row: row[:2]):
            writer.write(topics[which], written_ns, payload)


_MESSAGES = ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
_TOPICS = ("/joint_commands", "/joint_states")
