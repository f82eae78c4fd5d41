"""A writer may die at any moment, and several may write at once: the store is always whole."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from twin_daemon.versions import Draft, VersionStore
from twin_daemon.versions.verify import verify

ROOT = Path(__file__).resolve().parents[2]
KILLS = 25
WRITER = """
import itertools, sys
from pathlib import Path
from twin_daemon.versions import Draft, VersionStore

root, first, count = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
store = VersionStore("hand", root=root, shipped=root / "none")
print("ready", flush=True)
for number in itertools.islice(itertools.count(first), count):
    version = store.add(
        Draft(hand="hand", kind="calibrated", terms={"number": number}), f"<mujoco model='{number}'/>" * 200
    )
    store.promote(version.id)
    print(version.id, flush=True)
"""


PRUNER = """
import sys
from pathlib import Path
from twin_daemon.versions import Draft, VersionStore
from twin_daemon.versions.prune import Policy, prune

store = VersionStore("hand", root=Path(sys.argv[1]), shipped=Path(sys.argv[1]) / "none")
parent = None
for number in range(60):
    draft = Draft(hand="hand", kind="calibrated", terms={"number": number}, parent=parent)
    version = store.add(draft, f"<!-- {number} -->" + "<mujoco/>" * 200, alias="candidate").id
    if number % 3 == 0:
        parent = store.promote(version).id
    prune(store, Policy(keep=2, older_than_days=0.0))
"""


def start(root: Path, first: int, count: int) -> subprocess.Popen[str]:
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(root), str(first), str(count)], stdout=subprocess.PIPE, text=True
    )
    assert writer.stdout is not None
    assert writer.stdout.readline() == "ready\n"
    return writer


def test_a_kill_at_any_moment_leaves_a_whole_store(tmp_path: Path, draft: Callable[..., Draft], mjcf: str) -> None:
    root = tmp_path / "hand"
    bench = [sys.executable, "-m", "bench.store_kill", "--kills", str(KILLS), "--store", str(root)]
    done = subprocess.run(bench, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    returned = re.search(r"s, (\d+) operations had returned", done.stdout)
    assert returned is not None
    assert int(returned[1]) > KILLS, "no writer got far enough: the test would show nothing"
    store = VersionStore("hand", root=root, shipped=tmp_path / "none")
    assert verify(store).problems == ()
    store.add(draft(), mjcf)
    assert not list((root / "versions").glob(".*")), "what dead writers left is gone after the next write"
    assert not list(root.glob(".aliases*"))


def test_two_writers_at_once_lose_nothing(tmp_path: Path) -> None:
    root, each = tmp_path / "hand", 15
    writers = [start(root, first=number * 1000, count=each) for number in (1, 2)]
    stored = {line for writer in writers for line in writer.communicate()[0].split()}
    assert [writer.returncode for writer in writers] == [0, 0]
    store = VersionStore("hand", root=root, shipped=tmp_path / "none")
    versions, problems = store.survey()
    assert problems == []
    assert {version.id for version in versions[1:]} == stored
    assert len(stored) == 2 * each
    assert set(store.aliases()) == {"current", "previous"}


def test_two_writers_of_the_same_content_agree(tmp_path: Path) -> None:
    root, each = tmp_path / "hand", 10
    writers = [start(root, first=0, count=each) for _ in range(2)]
    said = [writer.communicate()[0].split() for writer in writers]
    assert said[0] == said[1]
    assert len(VersionStore("hand", root=root, shipped=tmp_path / "none").list()[1:]) == each


def test_a_reader_never_sees_half_a_version(tmp_path: Path) -> None:
    root = tmp_path / "hand"
    store = VersionStore("hand", root=root, shipped=tmp_path / "none")
    writer = start(root, first=0, count=60)
    reads = 0
    try:
        while writer.poll() is None:
            assert store.survey()[1] == []
            reads += 1
    finally:
        writer.kill()
        writer.communicate()
    assert reads > 1


def test_a_writer_that_hangs_keeps_no_reader_out(store: VersionStore, draft: Callable[..., Draft], mjcf: str) -> None:
    version = store.add(draft(), mjcf)
    with store.writing():
        assert store.list()[1:] == [version]


def test_a_reader_beside_one_who_prunes_sees_whole_versions_only(tmp_path: Path) -> None:
    root = tmp_path / "hand"
    store = VersionStore("hand", root=root, shipped=root / "none")
    pruner = subprocess.Popen([sys.executable, "-c", PRUNER, str(root)])
    problems: set[str] = set()
    reads = 0
    try:
        while pruner.poll() is None:
            problems |= {*store.survey()[1], *store.everything(trust=False).problems}
            reads += 1
    finally:
        pruner.kill()
        pruner.wait()
    assert pruner.returncode == 0
    assert problems == set()
    assert reads > 1
    assert len(verify(store).stubs) > 1, "nothing was pruned: the test would show nothing"
