"""A promoted version is what the running daemon predicts with."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from twin_daemon.daemon.models import ModelSource
from twin_daemon.daemon.notify import Notifier
from twin_daemon.errors import BadInput
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import Draft, Version, VersionStore


def stored(store: VersionStore, twin: TwinModel, damping: float) -> Version:
    terms = Terms(parameters={"rh_FFJ3.damping": damping})
    draft = Draft(hand=twin.hand.name, kind="calibrated", terms=terms.as_json())
    return store.add(draft, twin.changed(terms).mjcf(), alias="candidate")


def test_nothing_promoted_is_the_nominal_model(twin: TwinModel) -> None:
    source = ModelSource(twin.hand)
    _, info = source.load()
    assert info["id"] == "nominal"
    assert source.poll() is None
    answer = source.answer("")
    assert answer is not None
    assert answer["in_use"] == "nominal"
    assert source.answer("no-such-version") is None


def test_a_promotion_and_a_rollback_are_noticed(twin: TwinModel) -> None:
    source = ModelSource(twin.hand)
    source.load()
    first, second = (stored(source.store, twin, damping) for damping in (0.2, 0.3))
    assert source.poll() is None, "a candidate is not in use"
    for reference, expected, damping in ((first.id, first, 0.2), (second.id, second, 0.3)):
        source.store.promote(reference)
        found = source.poll()
        assert found is not None
        assert found[1]["id"] == expected.id
        assert found[0].parameter("rh_FFJ3.damping").read(found[0].model) == pytest.approx(damping)
    source.store.rollback()
    found = source.poll()
    assert found is not None
    assert found[1]["id"] == first.id
    assert source.poll() is None
    answer = source.answer(second.id)
    assert answer is not None
    assert answer["terms"]["parameters"] == {"rh_FFJ3.damping": 0.3}


def test_a_version_that_was_asked_for_stays(twin: TwinModel) -> None:
    store = VersionStore(twin.hand.name)
    first, second = (stored(store, twin, damping) for damping in (0.2, 0.3))
    source = ModelSource(twin.hand, first.id[:12])
    assert source.load()[1]["id"] == first.id
    store.promote(second.id)
    assert source.poll() is None


def test_a_version_that_cannot_be_used_is_reported_once(twin: TwinModel) -> None:
    source = ModelSource(twin.hand)
    source.load()
    draft = Draft(hand=twin.hand.name, kind="calibrated", terms={"from_the_future": 1.0})
    source.store.promote(source.store.add(draft, twin.mjcf()).id)
    with pytest.raises(BadInput, match="cannot read"):
        source.poll()
    assert source.poll() is None


def test_systemd_hears_ready_and_the_watchdog(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(str(path))
        receiver.settimeout(5.0)
        monkeypatch.setenv("NOTIFY_SOCKET", str(path))
        monkeypatch.setenv("WATCHDOG_USEC", "3000000")
        notifier = Notifier()
        notifier.say("READY=1")
        notifier.alive()
        notifier.alive()
        notifier.say("STOPPING=1")
        heard = [receiver.recv(100) for _ in range(3)]
    assert heard == [b"READY=1", b"WATCHDOG=1", b"STOPPING=1"]
    notifier.say("nobody listens any more")
