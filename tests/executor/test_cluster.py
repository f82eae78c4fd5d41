"""Work on a cluster gives the answers that this machine gives, whatever happens to the workers."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.executor.conftest import Dask
from twin_daemon.cli.app import main
from twin_daemon.cli.children import free_port
from twin_daemon.errors import BadInput, NoAnswer, UsageError
from twin_daemon.executor import concurrently, in_pieces, on_cluster
from twin_daemon.hand import load_hand
from twin_daemon.plant import Plant, parse_hidden
from twin_daemon.plant.motions import rich
from twin_daemon.plant.recording import record

SECONDS = 12.0


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One finger whose hidden effect takes a search to name."""
    hand = load_hand()
    path = tmp_path_factory.mktemp("plant") / "finger.mcap"
    plant = Plant(hand, seed=5, hidden=[parse_hidden("sensor_gain:FFJ3=severe", hand)], spread=0.1)
    record(plant, rich(hand, ("FFJ3",), SECONDS, 5), path)
    return path


def asked(path: Path, *arguments: str) -> dict[str, Any]:
    """What a command answers, without what tells one run from the next."""
    assert main([*arguments, "--json", str(path)]) == 0
    return {name: value for name, value in json.loads(path.read_text()).items() if name != "wall_s"}


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    "command",
    [
        ("calibrate", "--search", "least-squares", "--budget", "150", "--seed", "3"),
        ("diagnose", "--joints", "rh_FFJ3"),
    ],
    ids=lambda command: command[0],
)
def test_a_cluster_answers_what_this_machine_answers(
    command: tuple[str, ...], recording: Path, dask: Dask, tmp_path: Path
) -> None:
    dask.add_workers(2)
    told = (*command, "--recording", str(recording))
    here = asked(tmp_path / "here.json", *told)
    assert here.get("findings", here.get("history"))
    assert asked(tmp_path / "there.json", *told, "--cluster", dask.address) == here


def test_rows_are_shared_out_and_come_back_in_order(dask: Dask) -> None:
    dask.add_workers(2)
    rows = np.arange(14.0).reshape(7, 2)
    with on_cluster(dask.address):
        found = in_pieces(lambda some: np.hstack([some, np.full((len(some), 1), os.getpid())]), rows)
    np.testing.assert_array_equal(found[:, :2], rows)
    assert set(found[:, 2]) <= {worker.pid for worker in dask.workers}


def test_a_killed_worker_costs_its_tasks_a_retry_and_nothing_else(dask: Dask, tmp_path: Path) -> None:
    dask.add_workers(2)
    victim = dask.workers[0]
    runs = tmp_path / "runs"
    runs.mkdir()

    def work(item: int) -> int:
        (runs / f"{item}-{os.getpid()}-{time.monotonic_ns()}").touch()
        time.sleep(0.1)
        return item * item

    def kill() -> None:
        while len(list(runs.glob(f"*-{victim.pid}-*"))) < 3:
            time.sleep(0.01)
        os.kill(victim.pid, signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    with on_cluster(dask.address):
        assert concurrently(work, range(24)) == [item * item for item in range(24)]
    killer.join()
    ran = [tuple(map(int, path.name.split("-")))[:2] for path in runs.iterdir()]
    lost = {item for item, pid in ran if pid == victim.pid}
    survived = [item for item, pid in ran if pid != victim.pid]
    assert len(lost) >= 3
    assert sorted(survived) == list(range(24))  # each once: the others' tasks were left alone


def test_a_scheduler_that_goes_is_named(dask: Dask, tmp_path: Path) -> None:
    begun = tmp_path / "begun"

    def work(item: int) -> int:
        begun.touch()
        time.sleep(3.0)
        return item

    def kill() -> None:
        while not begun.exists():
            time.sleep(0.01)
        dask.scheduler.kill()

    dask.add_workers(1)
    killer = threading.Thread(target=kill)
    killer.start()
    with on_cluster(dask.address), pytest.raises(NoAnswer, match="the scheduler has gone"):
        concurrently(work, range(4))
    killer.join()


def test_what_a_task_raises_arrives_here(dask: Dask) -> None:
    def refuse(item: int) -> int:
        if item:
            raise BadInput(f"item {item} is no good", where="there")
        raise TimeoutError("a task's own")

    dask.add_workers(1)
    with on_cluster(dask.address):
        with pytest.raises(BadInput, match=r"there: item 1 is no good"):
            concurrently(refuse, [1])
        with pytest.raises(TimeoutError, match="a task's own"):
            concurrently(refuse, [0])


def test_a_scheduler_without_workers_is_no_cluster(dask: Dask) -> None:
    with pytest.raises(NoAnswer, match="has no worker"), on_cluster(dask.address):
        pass


def test_a_cluster_that_is_not_there_is_named() -> None:
    pytest.importorskip("distributed", reason="Dask (the extra `cluster`) is not installed")
    address = f"tcp://127.0.0.1:{free_port()}"
    with pytest.raises(NoAnswer, match=f"{address}: no Dask scheduler answers"), on_cluster(address):
        pass


@pytest.mark.parametrize("address", ["nonsense", "tcp://127.0.0.1:port", "carrier-pigeon://loft:1"])
def test_what_is_no_address_is_wrong_usage(address: str) -> None:
    pytest.importorskip("distributed", reason="Dask (the extra `cluster`) is not installed")
    with pytest.raises(UsageError, match="is no address"), on_cluster(address):
        pass


def test_without_dask_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(BadInput, match=r"twin_daemon\[cluster\]"), on_cluster("tcp://127.0.0.1:8786"):
        pass
