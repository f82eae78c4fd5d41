"""A joint wears while the daemon runs, and the daemon says by itself what has changed, where and by how much."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
import zenoh

from bridges.zenoh.client import ask
from bridges.zenoh.session import open_client
from tests.simulation.made import RATE_HZ, recorded, saved
from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample
from twin_daemon.hand import load_hand
from twin_daemon.recordings import load_recording
from twin_daemon.recordings.recording import Recording
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import VersionStore
from twin_daemon.versions.version import Draft, ParameterRecord, RecordingUsed

JOINT = "elbow"
OFF = {f"{JOINT}.damping": 0.23, f"{JOINT}.frictionloss": 0.017, f"{JOINT}.kp": 3.5}
_MODEL = """<mujoco model="elbow"><compiler angle="radian"/><option timestep="0.002"/><worldbody><body name="link">
<joint name="elbow" axis="0 1 0" range="-1.5 1.5" damping="0.2" armature="0.004" frictionloss="0.02"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.2" contype="0" conaffinity="0"/></body></worldbody>
<actuator><position name="elbow" joint="elbow" kp="4" ctrlrange="-1.5 1.5"/></actuator></mujoco>"""
_LEARNT_S, _WORN_S = 600.0, 200.0  # at most
_BEGIN_NS = 1_800_000_000_000_000_000
_EVERY = 4  # samples of the plant: one is published
_HELD_S = _EVERY / RATE_HZ
_ASKED = round(10.0 / _HELD_S)
_FASTER = 10.0  # than the hand's own clock, while the daemon learns what the hand is like


def _made(model: Path, name: str, seconds: float, seed: int, damping: float = 1.0) -> Recording:
    """The joint to and fro, mostly faster than 0.6 rad/s, by targets that hold for as long as they are published."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, seconds, _HELD_S)
    phase = np.cumsum(rng.uniform(0.4, 0.8, len(times))) * _HELD_S * 2.0 * np.pi
    terms = Terms(parameters=OFF | {f"{JOINT}.damping": damping * OFF[f"{JOINT}.damping"]})
    plant = TwinModel.load(load_hand(model=model)).changed(terms).at_step(0.001)
    targets = 0.6 * np.sin(phase) + 0.2 * np.sin(0.31 * phase)
    motion = {JOINT: (np.add.outer(times, [0.0, 0.99 * _HELD_S]).ravel().tolist(), np.repeat(targets, 2).tolist())}
    return recorded(plant, motion, rng, seconds=seconds, noise_rad=1e-3, name=name)


def _version(model: Path, state_dir: Path) -> str:
    """The promoted version of the healthy hand, with the recording that it was fitted to."""
    hand, healthy = load_hand(model=model), _made(model, "healthy", 10.0, 1)
    (state_dir / "recordings").mkdir(parents=True, exist_ok=True)
    seen = load_recording(saved(healthy, state_dir / "recordings" / "healthy.mcap"))
    store, terms = VersionStore.of(hand), Terms(parameters=OFF)
    draft = Draft(
        hand=hand.name,
        kind="calibrated",
        terms=terms.as_json(),
        parameters={name: ParameterRecord(value=v, ci95=(0.97 * v, 1.03 * v)) for name, v in OFF.items()},
        fitted_on=(RecordingUsed(name=seen.name, sha256=seen.sha256),),
    )
    version = store.add(draft, TwinModel.load(hand, terms).mjcf())
    return store.promote(version.id, force=True, reason="known to be right").id


def _sent(
    session: zenoh.Session, namespace: str, made: Recording, begin_ns: int, every: int = 1, faster: float = 1.0
) -> Iterator[int]:
    """Publishes one in so many samples of a recording as the hand would, so much faster than its clock goes at most.

    Yields their stamps.
    """
    assert made.commands is not None
    stamps = begin_ns + made.stamp_ns - made.stamp_ns[0]
    next_s = time.monotonic()
    for i in range(0, len(stamps), every):
        time.sleep(max(0.0, next_s - time.monotonic()))
        next_s = max(next_s, time.monotonic() - 1.0) + every / RATE_HZ / faster
        for stream, names, rows in (
            ("joint_commands", made.commands.names, made.commands.position),
            ("joint_states", made.joints, made.position),
        ):
            session.put(f"{namespace}/{stream}", cdr.encode(JointSample(int(stamps[i]), names, rows[i])))
        yield int(stamps[i])


@pytest.mark.slow
def test_a_drift_is_named_by_the_daemon_itself(twin: Any, tmp_path: Path, state_dir: Path, until: Any) -> None:
    model = tmp_path / "elbow.xml"
    model.write_text(_MODEL)
    (tmp_path / "twin.yaml").write_text(yaml.safe_dump({"model": str(model), "recalibration": {"nice": 0}}))
    version = _version(model, state_dir)
    namespace = load_hand(model=model).description.namespace
    healthy, worn = _made(model, "long", _LEARNT_S, 2), _made(model, "worn", _WORN_S, 3, damping=1.3)
    twin.start("run", "-c", str(tmp_path / "twin.yaml"))
    session = open_client(twin.endpoint, 60.0)
    assert session is not None
    with session:
        until(lambda: ask(session, f"twin/{namespace}/version", 10.0)["id"] == version, 60.0)
        last_ns = _BEGIN_NS
        for number, stamp_ns in enumerate(_sent(session, namespace, healthy, _BEGIN_NS, _EVERY, _FASTER), start=1):
            last_ns = stamp_ns
            # its answer also says that it has kept up
            if number % _ASKED == 0 and ask(session, f"twin/{namespace}/drift", 30.0)["verdict"] == "steady":
                break
        assert ask(session, f"twin/{namespace}/drift", 30.0)["verdict"] == "steady"
        told: list[dict[str, Any]] = []

        def heard(sample: zenoh.Sample) -> None:
            event = json.loads(sample.payload.to_bytes())
            if event["kind"] in ("changed", "alarm"):
                told.append(event)

        with session.declare_subscriber(f"twin/{namespace}/events", heard):
            for _ in _sent(session, namespace, worn, last_ns + round(_HELD_S * 1e9)):
                if told:
                    break
            until(lambda: told, 120.0)
        (event,) = told
        change = event["changes"][0]
        assert (change["effect"], change["joints"]) == ("viscous_friction", [JOINT])
        assert change["ratio"]["value"] == pytest.approx(1.3, rel=0.12)
        assert event["since_version"] == version
        assert f"{JOINT}: viscous friction +" in event["text"]
        assert change["remedy"] in event["text"]
        assert ask(session, f"twin/{namespace}/health", 10.0)["changed"] == [event["text"]]
    code, out, _ = twin.run("versions", "show", "current", "--model", str(model), "--json", "-")
    assert code == 0
    assert "viscous friction +" in out
