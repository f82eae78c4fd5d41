"""Requests that nobody waits for, at a gate in the same process."""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import zenoh

from bridges.ros2.link import ZenohLink
from bridges.ros2.requests import Requests
from bridges.zenoh.session import session_config
from tests.processes.conftest import free_port, until
from twin_daemon.gate.gate import Gate
from twin_daemon.gate.requests import read_request
from twin_daemon.gate.settings import GateSettings
from twin_daemon.hand import load_hand
from twin_daemon.security.identity import Identity, Keyring, Proof
from twin_daemon.security.signer import Signer
from twin_daemon.simulation.twin import TwinModel

KEYRING = Keyring({"ann": Identity(role="operator", key="ab" * 32)})


@pytest.fixture(scope="module")
def model() -> TwinModel:
    return TwinModel.load(load_hand())


class Office:
    """A gate on a router, and somebody who asks it."""

    def __init__(self, model: TwinModel) -> None:
        self.description = load_hand().description
        self._model = model
        self.asked: list[str] = []
        self.streamed: list[tuple[bytes, Proof | None]] = []
        self.begin_anew()
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.router = zenoh.open(session_config("router", listen=[endpoint]))
        self._entities: list[Any] = [
            self.router.declare_queryable(self.description.key("command", verb="*"), self._reply),
            self.router.declare_subscriber(self.description.key("command", verb="target"), self._target),
        ]
        self.link = ZenohLink(endpoint, self.description, lambda: None)
        until(lambda: self.link.tend() or self.link.connected)

    def begin_anew(self) -> None:
        """Another life of the gate, which hears the hand."""
        self.gate = Gate(self._model, GateSettings(state_timeout_s=5.0))
        count = len(self._model.joints)
        self.gate.measured(np.zeros(count), np.full(count, time.monotonic()))

    def _reply(self, query: zenoh.Query) -> None:
        with query:
            key = str(query.key_expr)
            verb, payload = key.rpartition("/")[2], query.payload.to_bytes() if query.payload else b""
            proof = Proof.decode(query.attachment.to_bytes()) if query.attachment else None
            self.asked.append(verb)
            now_s, wall_ns = time.monotonic(), time.time_ns()
            if verb == "status":
                answer = self.gate.status(now_s)
            else:
                who = KEYRING.who(verb, payload, proof)
                answer = self.gate.ask(verb, read_request(verb, payload), who, now_s, wall_ns)
            reply = json.dumps(answer).encode()
            known = proof is not None and KEYRING.who(verb, payload, proof) is not None
            signed = KEYRING.answer_proof(proof.who, verb, payload, reply).encode() if proof and known else None
            query.reply(key, reply, attachment=signed)

    def _target(self, sample: zenoh.Sample) -> None:
        proof = Proof.decode(sample.attachment.to_bytes()) if sample.attachment else None
        self.streamed.append((sample.payload.to_bytes(), proof))

    def ask(self, requests: Requests, verb: str, **body: Any) -> dict[str, Any]:
        answers: list[dict[str, Any]] = []
        requests.ask(verb, body, answers.append)
        until(lambda: self.link.settle() or answers)
        assert len(answers) == 1
        return answers[0]

    def close(self) -> None:
        self.link.close()
        for entity in self._entities:
            entity.undeclare()
        self.router.close()


@pytest.fixture
def office(model: TwinModel) -> Iterator[Office]:
    made = Office(model)
    yield made
    made.close()


def test_a_new_life_of_the_gate_is_noticed_and_asked_once_more(office: Office) -> None:
    requests = Requests(office.link, office.description, Signer(KEYRING, "ann"), "ann")
    assert office.ask(requests, "arm", reason="a test")["accepted"]
    office.begin_anew()
    assert office.ask(requests, "arm", reason="a test")["accepted"]
    assert office.asked == ["status", "arm", "arm", "arm"]
    assert requests.counts == {"command.arm.accepted": 2}
    assert office.ask(requests, "disarm")["accepted"]


def test_refusals_warn_once_and_are_counted(office: Office, caplog: pytest.LogCaptureFixture) -> None:
    requests = Requests(office.link, office.description, Signer(), "")
    for _ in range(3):
        assert office.ask(requests, "arm", reason="mine")["check"] == "role"
    assert requests.counts == {"command.arm.refused": 3}
    warnings = [record.message for record in caplog.records if record.levelno == logging.WARNING]
    assert len([line for line in warnings if "an identity with the role operator" in line]) == 1
    assert office.ask(requests, "stop")["accepted"], "without an identity, and without asking for a session"


def test_streamed_targets_are_signed(office: Office) -> None:
    requests = Requests(office.link, office.description, Signer(KEYRING, "ann"), "ann")
    requests.stream({"targets": {"rh_FFJ3": 0.1}}, stamp_ns=123)
    until(lambda: office.streamed)
    payload, proof = office.streamed[0]
    who = KEYRING.who("target", payload, proof)
    assert who is not None
    assert who.name == "ann"
    assert json.loads(payload)["stamp_ns"] == 123
    assert requests.counts == {"command.target.put": 1}


def test_of_the_events_only_its_own_count(office: Office, caplog: pytest.LogCaptureFixture) -> None:
    requests = Requests(office.link, office.description, Signer(KEYRING, "ann"), "ann")
    gate = {"kind": "gate", "verb": "target", "accepted": False, "check": "jump", "text": "too far"}
    for event in ({**gate, "who": "ann"}, {**gate, "who": "bob"}, {"kind": "drift"}, [1]):
        requests.heard_event(json.dumps(event).encode())
    requests.heard_event(json.dumps({**gate, "who": "ann", "verb": "trip", "text": "it has ended"}).encode())
    assert requests.counts == {"command.target.refused": 1, "command.ended": 1}
    assert {"too far", "it has ended"} <= {record.message for record in caplog.records}


def test_where_nobody_is_the_answer_says_so(office: Office) -> None:
    requests = Requests(office.link, office.description.model_copy(update={"namespace": "other"}), Signer(), "")
    answer = office.ask(requests, "arm", reason="x")
    assert answer["check"] == "no_answer"
    assert "twin/other/command/status" in answer["why"]
