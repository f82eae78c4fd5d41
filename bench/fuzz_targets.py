"""What is fuzzed: for each target where its inputs come from, and what may become of one of them."""

from __future__ import annotations

import contextlib
import csv
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from hypothesis import strategies as st
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from twin_daemon.calibration.spaces import load_space
from twin_daemon.daemon import cdr
from twin_daemon.daemon.configuration import load_config
from twin_daemon.daemon.messages import JointSample, MalformedPayload
from twin_daemon.errors import BadInput
from twin_daemon.gate.gate import Gate
from twin_daemon.gate.requests import KINDS, BadRequest, read_request
from twin_daemon.gate.settings import GateSettings
from twin_daemon.hand import load_hand
from twin_daemon.hand.mjcf import compile_model
from twin_daemon.recordings import load_joint_map, load_recording
from twin_daemon.security.identity import Keyring, Proof, Who, ensure_keyring
from twin_daemon.signals.trajectory import load_trajectory
from twin_daemon.simulation.terms import load_terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.yaml_files import load_yaml

GOOD, REFUSED = "read", "refused"


@dataclass(frozen=True)
class Prepared:
    """A target that is ready: its inputs, and what does one of them and says what became of it."""

    inputs: st.SearchStrategy[Any]
    try_one: Callable[[Any], str]


# -- damage -------------------------------------------------------------------------------------------------

_KINDS = ("flip", "cut", "insert", "repeat", "zero", "huge")
_EDIT = st.tuples(st.integers(0, 2**20), st.sampled_from(_KINDS), st.binary(max_size=9))


def damaged(whole: bytes, edits: list[tuple[int, str, bytes]]) -> bytes:
    """Bytes after some damage: each edit has a place, a kind, and bytes to put there."""
    data = bytearray(whole)
    for where, kind, more in edits:
        at = where % (len(data) + 1)
        if kind == "flip" and at < len(data):
            data[at] ^= more[0] if more else 1
        elif kind == "cut":
            del data[at : at + 7 * len(more) if more else None]
        elif kind == "insert":
            data[at:at] = more
        elif kind == "repeat":
            data[at:at] = data[max(at - 40, 0) : at] * min(len(more), 4)
        elif kind == "zero":
            data[at : at + 4] = bytes(4)
        elif kind == "huge":
            data[at : at + 4] = b"\xff\xff\xff\x7f"
    return bytes(data)


def _damage_of(wholes: list[bytes], most: int = 6) -> st.SearchStrategy[bytes]:
    return st.builds(damaged, st.sampled_from(wholes), st.lists(_EDIT, max_size=most))


# -- targets ------------------------------------------------------------------------------------------------


def _cdr(_folder: Path) -> Prepared:
    names = tuple(load_hand().joints)
    samples = [
        JointSample(1_700_000_000_123_456_789, names, np.linspace(-1.0, 1.0, len(names))),
        JointSample(0, names[:3], np.zeros(3), np.ones(3), np.ones(3)),
        JointSample(5, (), np.zeros(0)),
    ]
    wholes = [cdr.encode(sample) for sample in samples]

    def try_one(payload: bytes) -> str:
        try:
            sample = cdr.decode(payload)
        except MalformedPayload:
            return REFUSED
        assert isinstance(sample.stamp_ns, int)
        assert sample.position.ndim == 1
        return GOOD

    return Prepared(st.one_of(_damage_of(wholes), st.binary(max_size=400)), try_one)


_TOKENS = (
    "daemon gate ros access recalibration cron quiet hand model endpoint namespace version horizon_s limits rh_FFJ3 "
    "velocity_rad_s transport domain schema name joints commands actuator parameters effects effect target values kind "
    "trajectories times position_trajectories 0.5 -1 1e999 .nan .inf 2001-99-99 0x 0b2 1:99:99 ~ null true yes !!int "
    "!!binary !!timestamp !!python/object !!set !!omap !!pairs <<: *a *b &a &b - : ? | > [ ] { } , # % @ ` ' \" "
    "!!float \\ \n \n\n \t --- ... 99999999999999999999"
)
_WORDS = _TOKENS.split(" ")


def _yaml_text() -> st.SearchStrategy[str]:
    line = st.lists(st.one_of(st.sampled_from(_WORDS), st.text(max_size=4)), max_size=6).map(" ".join)
    tokens = st.lists(st.tuples(st.integers(0, 4), line), max_size=12).map(
        lambda lines: "\n".join("  " * depth + text for depth, text in lines)
    )
    value = st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.dates(),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(_WORDS), inner, max_size=4),
        max_leaves=12,
    ).map(lambda one: yaml.safe_dump(one, allow_unicode=True))
    signs = st.sampled_from(["[", "{a: ", "- ", "? ", "[[", "*"])
    deep = st.builds(lambda sign, count: sign * count, signs, st.integers(0, 3000))
    bomb = st.builds(_alias_bomb, st.integers(1, 12), st.integers(1, 12))
    return st.one_of(tokens, value, deep, bomb)


def _alias_bomb(levels: int, width: int) -> str:
    lines = ["a0: &a0 [x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * width)}]" for n in range(1, levels)]
    return "\n".join(lines)


def _yaml(folder: Path) -> Prepared:
    hand, path = load_hand(), folder / "it.yaml"
    wholes = [one.read_bytes() for one in (hand.model_path.parent / "hand.yaml",)]
    readers: list[Callable[[], object]] = [
        lambda: load_hand(path),
        lambda: load_trajectory(path, hand),
        lambda: load_joint_map(path),
        lambda: load_terms(path),
        lambda: load_space(str(path)),
    ]

    def try_one(given: tuple[str | bytes, int]) -> str:
        content, which = given
        if isinstance(content, str):
            with contextlib.suppress(yaml.YAMLError):
                load_yaml(content)
            content = content.encode("utf-8", "surrogatepass")
        path.write_bytes(content)
        return _bad_input_alone(readers[which])

    return Prepared(st.tuples(st.one_of(_yaml_text(), _damage_of(wholes)), st.integers(0, len(readers) - 1)), try_one)


def _config(folder: Path) -> Prepared:
    path = folder / "twin.yaml"
    keys = st.lists(st.sampled_from([*_WORDS, "DAEMON", "GATE", "LIMITS", "HORIZON_S", "ACCESS", ""]), max_size=4)
    names = keys.map(lambda parts: "TWIN_" + "__".join(parts))
    environment = st.dictionaries(names, st.one_of(_yaml_text(), st.sampled_from(_WORDS)), max_size=3)

    def try_one(given: tuple[str, dict[str, str]]) -> str:
        path.write_bytes(given[0].encode("utf-8", "surrogatepass"))
        return _bad_input_alone(lambda: load_config(path, given[1]))

    return Prepared(st.tuples(_yaml_text(), environment), try_one)


def _bad_input_alone(action: Callable[[], object]) -> str:
    try:
        action()
    except BadInput as error:
        line = str(error)
        assert "\n" not in line, line
        assert len(line) < 3000, f"{len(line)} characters"
        return REFUSED
    return GOOD


def _requests(folder: Path) -> Prepared:
    twin = TwinModel.load(load_hand())
    gate = Gate(twin, GateSettings(), session="s")
    keyring: Keyring = ensure_keyring(folder / "keys.json")
    operator, joints = Who("operator", "operator"), list(twin.joints)
    usual = {"session": "s", "sequence": 1, "stamp_ns": 10**18, "reason": "try", "targets": {"rh_FFJ3": 0.2}}
    path = {"joints": joints[:2], "times_s": [0.0, 1.0], "positions": [[0.0, 0.0], [0.1, 0.1]]}
    wholes = [json.dumps(one).encode() for one in (usual, path, usual | path | {"dry_run": False, "seconds": 1.0})]
    number = st.one_of(st.floats(), st.integers(), st.sampled_from([1e308, -1e308, 1e-320, 2**63, "NaN", None]))
    field = st.one_of(
        number,
        st.text(max_size=5),
        st.dictionaries(st.sampled_from([*joints[:6], "rh_FFJ0", "no"]), number, max_size=4),
        st.lists(number, max_size=5),
        st.lists(st.lists(number, max_size=3), max_size=5),
        st.lists(st.sampled_from(joints), max_size=4),
    )
    names = ["session", "stamp_ns", "reason", "lease_s", "targets", "joints", "times_s", "positions", "name", "seconds"]
    fields = st.dictionaries(st.sampled_from(names), field, max_size=5)
    made = fields.map(lambda one: json.dumps({"session": "s"} | one).encode())
    deep = st.integers(1, 100_000).map(lambda count: b'{"targets": ' + b"[" * count)
    payloads = st.one_of(made, _damage_of(wholes), st.binary(max_size=60), deep)
    count = 0

    def try_one(given: tuple[str, bytes, bytes]) -> str:
        nonlocal count
        count += 1
        verb, payload, attachment = given
        proof = Proof.decode(attachment)
        assert proof is None or keyring.who(verb, payload, proof) is None, "a proof that nobody made is believed"
        now_s = 1000.0 + 0.01 * count
        gate.measured(np.zeros(len(joints)), np.full(len(joints), now_s))
        try:
            request = read_request(verb, payload)
        except BadRequest:
            return REFUSED
        gate.turn(now_s, 10**18 + count)
        answer = gate.ask(verb, request.model_copy(update={"sequence": count}), operator, now_s, 10**18)
        json.dumps(answer, allow_nan=False)
        return "accepted" if answer["accepted"] else REFUSED

    proofs = st.one_of(st.binary(max_size=40), _damage_of([Proof("operator", "0" * 64).encode()]))
    return Prepared(st.tuples(st.sampled_from(sorted(KINDS)), payloads, proofs), try_one)


def _recordings(folder: Path) -> Prepared:
    forms = {name: write(folder) for name, write in _FORMS.items()}
    wholes = {name: path.read_bytes() for name, path in forms.items()}
    inputs = st.sampled_from(sorted(wholes)).flatmap(
        lambda name: st.tuples(st.just(name), _damage_of([wholes[name]], 4))
    )

    def try_one(given: tuple[str, bytes]) -> str:
        name, content = given
        path = folder / f"it{forms[name].suffix}"
        path.write_bytes(content)
        return _bad_input_alone(lambda: load_recording(path))

    return Prepared(inputs, try_one)


def _csv(folder: Path) -> Path:
    path = folder / "whole.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["name", "position", "velocity", "effort", "timestamp_nsecs"])
        for sample in range(20):
            writer.writerow(["['a', 'b']", f"(1.0, {sample}.0)", "()", "()", 10**18 + sample * 10**7])
    return path


def _bag1(folder: Path) -> Path:
    path = folder / "whole.bag"
    with Writer1(path) as writer:
        _fill(writer, Stores.ROS1_NOETIC)
    return path


def _bag2(plugin: StoragePlugin, suffix: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = folder / f"whole-{suffix}"
        with Writer2(path, version=9, storage_plugin=plugin) as writer:
            _fill(writer, Stores.ROS2_JAZZY)
        return path / f"{path.name}.{suffix}"

    return write


def _fill(writer: Any, stores: Stores) -> None:
    store = get_typestore(stores)
    kind, ros1 = "sensor_msgs/msg/JointState", stores is Stores.ROS1_NOETIC
    connection = writer.add_connection("/joint_states", kind, typestore=store)
    for sample in range(20):
        stamp = store.types["builtin_interfaces/msg/Time"](sec=1_700_000_000, nanosec=sample * 10_000_000)
        header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="", **({"seq": sample} if ros1 else {}))
        position = np.array([0.1, 0.01 * sample])
        message = store.types[kind](header, ["rh_FFJ1", "rh_FFJ2"], position, np.zeros(2), np.zeros(0))
        content = store.serialize_ros1(message, kind) if ros1 else store.serialize_cdr(message, kind)
        writer.write(connection, 1_700_000_000 * 10**9 + sample * 10**7, bytes(content))


_FORMS: dict[str, Callable[[Path], Path]] = {
    "csv": _csv,
    "ros1": _bag1,
    "mcap": _bag2(StoragePlugin.MCAP, "mcap"),
    "sqlite3": _bag2(StoragePlugin.SQLITE3, "db3"),
}


_HOSTILE = "1e999 -1 nan 0 1 99999999999 ../../etc/passwd /dev/zero loop.xml it.xml 64G &x; 1e300"
_PLACES = (
    "size:memory size:njmax size:nuserdata include:file mesh:file texture:file hfield:nrow replicate:count "
    "composite:count flexcomp:count joint:damping joint:range geom:size geom:pos option:timestep compiler:meshdir "
    "plugin:plugin"
)


def _mjcf(folder: Path) -> Prepared:
    path = folder / "it.xml"
    (folder / "loop.xml").write_text('<mujoco><include file="loop.xml"/><include file="it.xml"/></mujoco>')
    hostile = st.one_of(
        st.sampled_from(_HOSTILE.split(" ")),
        st.floats().map(str),
        st.lists(st.integers(-9, 2**40), max_size=4).map(lambda numbers: " ".join(map(str, numbers))),
    )
    element = st.sampled_from(_PLACES.split(" "))
    piece = st.builds(_piece, element, hostile)
    deep = st.integers(0, 3000).map(lambda count: "<body>" * count + "</body>" * count)
    pieces = st.lists(piece, max_size=4).map("".join)
    made = st.builds(_model, pieces, st.one_of(pieces, deep))
    bombs = st.integers(1, 12).map(_entity_bomb)
    inputs = st.one_of(made, bombs, _damage_of([_model("", "").encode()]).map(lambda data: data.decode("latin-1")))

    def try_one(text: str) -> str:
        path.write_text(text, encoding="latin-1", errors="replace")
        return _bad_input_alone(lambda: compile_model(path))

    return Prepared(inputs, try_one)


def _piece(named: str, value: str) -> str:
    tag, key = named.split(":")
    attribute = value.replace("<", "").replace('"', "")
    inner = f'<{tag} {key}="{attribute}"/>'
    if tag in ("mesh", "texture", "hfield"):
        return f'<asset><{tag} name="n{len(value)}" {key}="{attribute}"/></asset>'
    return f'<{tag} {key}="{attribute}"><geom size="1"/></{tag}>' if tag == "replicate" else inner


def _model(top: str, body: str) -> str:
    return (
        f'<mujoco>{top}<worldbody><body name="a"><joint name="j" range="-1 1"/><geom size="0.1" mass="1"/>{body}</body>'
        '</worldbody><actuator><position joint="j" name="p" kp="1"/></actuator></mujoco>'
    )


def _entity_bomb(levels: int) -> str:
    entities = "".join(f'<!ENTITY e{n} "{f"&e{n - 1};" * 10}">' for n in range(1, levels))
    return f'<!DOCTYPE m [<!ENTITY e0 "x">{entities}]><mujoco model="&e{levels - 1};"/>'


TARGETS: dict[str, Callable[[Path], Prepared]] = {
    "cdr": _cdr,
    "yaml": _yaml,
    "config": _config,
    "requests": _requests,
    "recordings": _recordings,
    "mjcf": _mjcf,
}
