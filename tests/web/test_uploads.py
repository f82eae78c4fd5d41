"""Recordings that come through the page: whole ones are offered, everything else leaves nothing behind."""

from __future__ import annotations

import hashlib
import json
import os
import socket
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from tests.processes.conftest import Twin
from tests.simulation.made import worn_finger
from tests.web.conftest import Workbench
from twin_daemon.errors import BadInput
from twin_daemon.hand import load_hand
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import VersionStore
from twin_daemon.web.model_cache import ModelCache

PIECE = 40_000


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = worn_finger(TwinModel.load(load_hand()), tmp_path_factory.mktemp("bags") / "worn.mcap")
    return path.read_bytes()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("recordings")


@pytest.fixture(scope="module")
def served(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workbench]:
    with Twin(tmp_path_factory.mktemp("served")) as processes:
        running = Workbench(processes, "--folder", str(folder), "--most-upload", "2")
        yield running
        assert running.end() == 0


def piece(served: Workbench, number: str, offset: int, content: bytes, *, token: bool = True) -> tuple[int, Any]:
    request = urllib.request.Request(
        f"{served.address}/api/upload/piece?id={number}&offset={offset}",
        content,
        {"Content-Type": "application/octet-stream"} | ({"X-Twin-Token": served.token} if token else {}),
    )
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            return answer.status, json.loads(answer.read())
    except urllib.error.HTTPError as error:
        with error:
            return error.code, json.loads(error.read())


def begun(served: Workbench, name: str, size: int) -> str:
    status, answer = served.ask("/api/upload/begin", {"name": name, "bytes": size})
    assert status == 200, answer
    return answer["id"]


def sent(served: Workbench, name: str, content: bytes) -> tuple[int, Any]:
    number = begun(served, name, len(content))
    for offset in range(0, len(content), PIECE):
        status, answer = piece(served, number, offset, content[offset : offset + PIECE])
        assert (status, answer["has"]) == (200, min(offset + PIECE, len(content)))
    return served.ask("/api/upload/end", {"id": number})


def offered(served: Workbench) -> list[str]:
    return [one["name"] for one in served.ask("/api/recordings")[1]["recordings"]]


def test_a_recording_in_pieces_is_offered_and_overwrites_nothing(served: Workbench, folder: Path, bag: bytes) -> None:
    status, answer = sent(served, "../of the lab/run 1.mcap", bag)
    assert (status, answer["name"]) == (200, "run_1.mcap")
    told = served.ask(f"/api/recording?recording={answer['id']}")[1]
    assert (told["name"], told["samples"]) == ("run_1", 689)
    assert (folder / "run_1.mcap").read_bytes() == bag
    assert sent(served, "run 1.mcap", bag)[1]["name"] == "run_1-2.mcap"
    assert sorted(offered(served)) == ["run_1-2.mcap", "run_1.mcap"]
    assert list((folder / ".uploads").iterdir()) == []


def test_what_was_screened_is_not_read_again_until_the_file_is_another_one(bag: bytes, tmp_path: Path) -> None:
    hand = load_hand()
    cache = ModelCache(hand, VersionStore(hand.name))
    (arrived := tmp_path / "7f-run.mcap").write_bytes(bag)
    aligned, told, offered = (
        cache.screen(arrived, hashlib.sha256(bag).hexdigest()),
        arrived.stat(),
        tmp_path / "run.mcap",
    )
    offered.write_bytes(bytes(len(bag)))  # so that reading it would be seen
    os.utime(offered, ns=(told.st_atime_ns, told.st_mtime_ns))
    cache.adopt(aligned, offered, told)
    recording = cache.recording(offered).recording
    assert (recording.name, recording.path, len(recording.stamp_ns)) == ("run", offered, 689)
    offered.touch()
    with pytest.raises(BadInput, match="not a recording"):
        cache.recording(offered)
    cache.close()


def test_what_is_no_recording_is_refused_and_gone(served: Workbench, folder: Path, bag: bytes) -> None:
    before = offered(served)
    for name, content in (("text.csv", b"root:hunter2\nmore\n"), ("noise.mcap", bytes(3000)), ("bag.bag", bag[::-1])):
        status, answer = sent(served, name, content)
        assert (status, "hunter2" in json.dumps(answer)) == (400, False), answer
        assert name in answer["error"]
    assert offered(served) == before
    assert list((folder / ".uploads").iterdir()) == []


def test_pieces_come_in_order_and_no_more_than_was_announced(served: Workbench, folder: Path, bag: bytes) -> None:
    number = begun(served, "a.mcap", len(bag))
    assert piece(served, number, 5, bag[5:10])[0] == 400
    assert piece(served, number, 0, bag[:10], token=False)[0] == 401
    assert piece(served, number, 0, bag[:10])[1] == {"has": 10}
    assert piece(served, number, 0, bag[:10])[0] == 400, "the same again"
    assert piece(served, number, 10, bag[10:] + b"more")[0] == 400
    assert piece(served, number, 10, bytes(4 * 1024 * 1024 + 1))[0] == 400
    assert piece(served, number, 10, bytes(16 * 1024 * 1024 + 1))[0] == 400
    assert "Send the rest" in served.ask("/api/upload/end", {"id": number})[1]["error"]
    assert piece(served, "../../etc/passwd", 0, b"x")[0] == 400
    assert served.ask("/api/upload/cancel", {"id": number}) == (200, {})
    assert piece(served, number, 10, bag[10:20])[0] == 400
    assert list((folder / ".uploads").iterdir()) == []


def test_a_piece_waits_for_the_one_before_it_that_is_still_on_its_way(
    served: Workbench, folder: Path, bag: bytes
) -> None:
    number = begun(served, "beside.mcap", len(bag))
    head = (
        f"POST /api/upload/piece?id={number}&offset=0 HTTP/1.1\r\nHost: {served.host}\r\n"
        f"X-Twin-Token: {served.token}\r\nContent-Length: {PIECE}\r\nConnection: close\r\n\r\n"
    )
    place, _, port = served.host.partition(":")
    with socket.create_connection((place, int(port)), timeout=60) as first, ThreadPoolExecutor(1) as beside:
        first.sendall(head.encode() + bag[:1000])
        time.sleep(0.2)  # until the server has heard of it
        second = beside.submit(piece, served, number, PIECE, bag[PIECE:])
        with pytest.raises(TimeoutError):
            second.result(0.5)
        first.sendall(bag[1000:PIECE])
        assert first.makefile("rb").readline().split()[1] == b"200"
        assert second.result(60) == (200, {"has": len(bag)})
    assert served.ask("/api/upload/end", {"id": number})[1]["name"] == "beside.mcap"
    assert (folder / "beside.mcap").read_bytes() == bag


def test_a_piece_does_not_wait_for_one_that_is_lost(served: Workbench, bag: bytes) -> None:
    number = begun(served, "lost.mcap", len(bag))
    head = f"POST /api/upload/piece?id={number}&offset=0 HTTP/1.1\r\nHost: {served.host}\r\n"
    place, _, port = served.host.partition(":")
    with ThreadPoolExecutor(1) as beside:
        with socket.create_connection((place, int(port)), timeout=60) as first:
            first.sendall(f"{head}X-Twin-Token: {served.token}\r\nContent-Length: {PIECE}\r\n\r\n".encode())
            time.sleep(0.2)
            second = beside.submit(piece, served, number, PIECE, bag[PIECE:])
            with pytest.raises(TimeoutError):
                second.result(0.5)
        status, answer = second.result(20)
    assert (status, "begins at byte" in answer["error"]) == (400, True)
    assert served.ask("/api/upload/cancel", {"id": number}) == (200, {})


def test_names_sizes_and_numbers_are_bounded(served: Workbench) -> None:
    for name, size in (
        ("a.sh", 10), (".mcap", 10), ("", 10), ("a.mcap/../../x", 10), ("a.mcap", 0), ("a.mcap", -1),
        ("a.mcap", 2_000_001), ("a.mcap", True), ("a.mcap", "10"),
    ):  # fmt: skip
        assert served.ask("/api/upload/begin", {"name": name, "bytes": size})[0] == 400, (name, size)
    assert served.ask("/api/upload/begin", {"name": "a.mcap", "bytes": 10}, token=False)[0] == 401
    numbers = [begun(served, "a.mcap", 10) for _ in range(4)]
    assert served.ask("/api/upload/begin", {"name": "a.mcap", "bytes": 10})[0] == 409
    for number in numbers:
        assert served.ask("/api/upload/cancel", {"id": number})[0] == 200


def test_a_link_in_place_of_the_folder_on_the_way_is_refused(workbench: Any, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "offered").mkdir()
    (tmp_path / "offered" / ".uploads").symlink_to(tmp_path / "elsewhere")
    served = workbench("--folder", str(tmp_path / "offered"))
    status, answer = served.ask("/api/upload/begin", {"name": "a.mcap", "bytes": 10})
    assert (status, "own folder" in answer["error"]) == (400, True)
    assert list((tmp_path / "elsewhere").iterdir()) == []


def test_a_folder_of_links_is_not_written_through(served: Workbench, folder: Path, bag: bytes, tmp_path: Path) -> None:
    (folder / "trap.mcap").symlink_to(tmp_path / "elsewhere")
    assert sent(served, "trap.mcap", bag)[1]["name"] == "trap-2.mcap"
    assert not (tmp_path / "elsewhere").exists()
