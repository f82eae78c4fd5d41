"""A stop outlives the gate that took it, whatever state its file is in."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from tests.gate.conftest import ANN, EVE, Rig
from twin_daemon.gate.gate import Gate
from twin_daemon.gate.latch import Latch
from twin_daemon.gate.requests import KINDS
from twin_daemon.gate.settings import GateSettings
from twin_daemon.simulation.twin import TwinModel


class Latched(Rig):
    """A rig whose gate keeps its latch in a file."""

    def __init__(self, twin: TwinModel, path: Path) -> None:
        super().__init__(twin)
        self.gate = Gate(twin, GateSettings(), self.entries.append, session="now", latch=Latch(path))
        self.hear()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "hands" / "some" / "stopped.json"


def test_a_stop_is_on_disk_when_it_is_answered_and_gone_when_a_release_is(twin: TwinModel, path: Path) -> None:
    rig = Latched(twin, path)
    answer = rig.ask("stop", EVE, reason="smoke")
    assert answer["latch_kept"]
    assert "smoke" in json.loads(path.read_text())["why"]
    again = Latched(twin, path)
    assert again.status["mode"] == "stopped"
    assert "smoke" in again.status["ended"]
    assert again.ask("arm", reason="a test")["check"] == "stopped"
    assert again.ask("release")["check"] == "reason"
    assert path.exists()
    assert again.ask("release", reason="no smoke")["accepted"]
    assert not path.exists()
    assert Latched(twin, path).status["mode"] == "read_only"


@pytest.mark.parametrize("content", [b"", b"{", b"null", b'{"schema": 1}', b"\xff" * 100, b"[" * 20_000])
def test_a_damaged_latch_is_a_stop(twin: TwinModel, path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True)
    path.write_bytes(content)
    rig = Latched(twin, path)
    assert rig.ask("arm", reason="a test")["check"] == "stopped"
    assert rig.ask("release", reason="looked at it")["accepted"]
    assert Latched(twin, path).status["mode"] == "read_only"


def test_one_that_is_no_file_is_a_stop_that_cannot_be_released(twin: TwinModel, path: Path) -> None:
    path.mkdir(parents=True)
    rig = Latched(twin, path)
    assert rig.status["mode"] == "stopped"
    assert rig.ask("release", reason="a test")["check"] == "latch"
    assert rig.status["mode"] == "stopped"


def test_a_stop_that_cannot_be_kept_is_a_stop_and_says_so(twin: TwinModel, path: Path) -> None:
    path.parent.parent.mkdir(parents=True)
    path.parent.write_text("a file in the folder's place")
    rig = Latched(twin, path)
    if rig.status["mode"] == "stopped":  # what cannot be read means latched
        assert rig.ask("release", reason="a test")["check"] == "latch"
        return
    rig.arm()
    answer = rig.ask("stop")
    assert answer["accepted"]
    assert not answer["latch_kept"]
    assert "ends with this process" in answer["latch_why"]
    assert rig.status["mode"] == "stopped"


def test_the_latch_is_synced_before_the_answer(twin: TwinModel, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By name, too: the folder's entry is synced after the file's content."""
    synced: list[str] = []
    real = os.fsync

    def noted(handle: int) -> None:
        synced.append(str(Path(f"/proc/self/fd/{handle}").readlink()))
        real(handle)

    monkeypatch.setattr(os, "fsync", noted)
    rig = Latched(twin, path)
    rig.ask("stop")
    assert path.name in synced[-2]
    assert synced[-1] == str(path.parent)
    synced.clear()
    rig.ask("release", ANN, reason="a test")
    assert synced == [str(path.parent)]


def test_stops_that_repeat_write_the_latch_once(twin: TwinModel, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Latched(twin, path)
    rig.ask("stop")
    monkeypatch.setattr(os, "fsync", lambda _: pytest.fail("another write"))
    request: dict[str, Any] = {"reason": "again"}
    for _ in range(20):
        assert rig.gate.ask("stop", KINDS["stop"](**request), None, rig.now_s, rig.wall_ns)["latch_kept"]
