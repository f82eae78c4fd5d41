"""A full disk, a read-only disk, a clock that jumps, a damaged index: nothing is lost, and what happened is said."""

from __future__ import annotations

import json
import logging
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from twin_daemon.versions import Draft, VersionStore
from twin_daemon.versions.verify import verify

# Its own mounts, so that nothing stays behind; the disk is at `disk` and may be filled or made read-only in there.
ON_A_SMALL_DISK = """
import json, subprocess, sys
from pathlib import Path
from twin_daemon.errors import BadInput
from twin_daemon.versions import Draft, VersionStore
from twin_daemon.versions.prune import Policy, prune
from twin_daemon.versions.verify import verify

disk, trouble = Path(sys.argv[1]), sys.argv[2]
subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", disk], check=True)
store = VersionStore("hand", root=disk / "hand", shipped=disk / "none")

def add(number):
    draft = Draft(hand="hand", kind="calibrated", terms={"number": number})
    return store.add(draft, f"<!-- {number} -->" + "<mujoco/>" * 2000, alias="candidate").id

stored = [add(number) for number in range(4)]
for version in stored:
    store.promote(version)
store.everything()  # writes the index, which is what gives way on a full disk
if trouble == "full":
    with (disk / "filler").open("wb", buffering=0) as filler:
        try:
            while True:
                filler.write(bytes(4096))
        except OSError:
            pass
else:
    subprocess.run(["mount", "-o", "remount,ro", disk], check=True)

def said(action):
    try:
        return ["done", action()]
    except BadInput as error:
        return ["refused", error.line()]

result = {
    "stored": stored,
    "add": said(lambda: add(99)),
    "problems": verify(store).problems,
    "listed": [version.id for version in store.list()[1:]],
    "rollback": said(lambda: store.rollback().id),
    "current": store.aliases()["current"],
    "verified": verify(store).problems,
}
if trouble == "full":
    (disk / "filler").unlink()
    result["later"] = add(100) in [version.id for version in store.list()[1:]]
print(json.dumps(result))
"""
LIMITED = """
import json, resource, sys
from pathlib import Path
from twin_daemon.errors import BadInput
from twin_daemon.versions import Draft, VersionStore

store = VersionStore("hand", root=Path(sys.argv[1]), shipped=Path(sys.argv[1]) / "none")
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, resource.RLIM_INFINITY))
try:
    store.add(Draft(hand="hand", kind="calibrated", terms={"big": 1}), "<mujoco/>" * 10_000, alias="candidate")
except BadInput as error:
    print(json.dumps(error.line()))
"""


def on_a_small_disk(tmp_path: Path, trouble: str) -> dict:
    disk = tmp_path / "disk"
    disk.mkdir()
    alone = ["unshare", "--user", "--map-root-user", "--mount"]
    if subprocess.run([*alone, "mount", "-t", "tmpfs", "tmpfs", str(disk)], capture_output=True).returncode:
        pytest.skip("this machine lets nobody mount a small disk (unshare --user --mount)")
    done = subprocess.run(
        [*alone, sys.executable, "-c", ON_A_SMALL_DISK, str(disk), trouble], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_a_full_disk_refuses_what_is_new_and_lets_one_go_back(tmp_path: Path) -> None:
    result = on_a_small_disk(tmp_path, "full")
    outcome, words = result["add"]
    assert outcome == "refused"
    assert "no space" in words
    assert "twin versions prune" in words
    assert result["problems"] == result["verified"] == []
    assert result["listed"] == result["stored"]
    assert result["rollback"] == ["done", result["stored"][-2]], "going back must be possible on a full disk"
    assert result["current"] == result["stored"][-2]
    assert result["later"], "with space again everything goes on"


def test_a_read_only_disk_can_be_read(tmp_path: Path) -> None:
    result = on_a_small_disk(tmp_path, "read-only")
    for action in ("add", "rollback"):
        outcome, words = result[action]
        assert outcome == "refused"
        assert "Read-only" in words
        assert "TWIN_STATE_DIR" in words
    assert result["problems"] == []
    assert result["listed"] == result["stored"]
    assert result["current"] == result["stored"][-1]


def test_a_version_that_cannot_be_written_whole_is_not_there(
    store: VersionStore, draft: Callable[..., Draft], mjcf: str
) -> None:
    good = store.add(draft(), mjcf, alias="candidate")
    done = subprocess.run([sys.executable, "-c", LIMITED, str(store.root)], capture_output=True, text=True, check=True)
    assert "no space" in json.loads(done.stdout)
    assert store.list()[1:] == [good]
    assert store.aliases() == {"current": "nominal", "candidate": good.id}
    assert verify(store).problems == ()
    assert not list(store.contents.folders.glob(".*"))


def test_a_clock_that_jumps_back_a_day_does_not_turn_the_order_around(
    tmp_path: Path, draft: Callable[..., Draft], mjcf: str
) -> None:
    clock = [datetime(2026, 3, 2, 12, tzinfo=UTC)]
    store = VersionStore("hand", root=tmp_path / "hand", shipped=tmp_path / "none", now=lambda: clock[0])
    made = []
    for damping, jump in ((0.1, -1.0), (0.2, 2.0), (0.3, -0.5), (0.4, 0.0)):
        made.append(store.promote(store.add(draft(damping), mjcf, alias="candidate").id).id)
        clock[0] += timedelta(days=jump)
    assert [version.id for version in store.list()[1:]] == made
    assert store.aliases() == {"current": made[-1], "previous": made[-2]}
    assert [decision.sequence for decision in store.decisions().decisions] == list(range(1, 9))
    assert verify(store).problems == ()


@pytest.mark.parametrize(
    "harm",
    [
        lambda path: path.write_bytes(b"no database at all, but long enough to be taken for one" * 40),
        lambda path: path.write_bytes(path.read_bytes()[:5000]),
        lambda path: path.write_bytes(path.read_bytes()[:100] + bytes(2000) + path.read_bytes()[2100:]),
    ],
    ids=["garbage", "cut", "holes"],
)
def test_a_damaged_index_is_built_again_by_itself(
    harm: Callable[[Path], object],
    store: VersionStore,
    draft: Callable[..., Draft],
    mjcf: str,
    caplog: pytest.LogCaptureFixture,
) -> None:
    made = [store.add(draft(damping), mjcf).id for damping in (0.1, 0.2, 0.3)]
    assert [version.id for version in store.list()[1:]] == made
    index = store.root / "index.sqlite"
    harm(index)
    with caplog.at_level(logging.WARNING, logger="twin"):
        assert [version.id for version in store.list()[1:]] == made
    assert "index of versions is damaged" in caplog.text
    found = verify(store)
    assert (found.problems, found.index) == ((), "fresh")


def test_a_missing_index_is_built_again_and_a_stale_one_is_not_believed(
    store: VersionStore, draft: Callable[..., Draft], mjcf: str
) -> None:
    first, second = (store.add(draft(damping), mjcf) for damping in (0.1, 0.2))
    assert store.list()[1:] == [first, second]
    (store.root / "index.sqlite").unlink()
    assert store.list()[1:] == [first, second]
    assert (store.root / "index.sqlite").is_file()
    record = store.resolve(second.id).folder / "version.json"
    record.chmod(0o644)
    record.write_bytes(record.read_bytes().replace(b"0.2", b"0.7"))
    versions, problems = store.survey()
    assert versions[1:] == [first]
    assert len(problems) == 1


def test_a_row_that_lies_is_not_believed(store: VersionStore, draft: Callable[..., Draft], mjcf: str) -> None:
    version = store.add(draft(), mjcf)
    assert store.list()[1:] == [version]
    with closing(sqlite3.connect(store.root / "index.sqlite")) as connection, connection:
        connection.execute("UPDATE versions SET record = replace(record, '0.1', '0.9')")
    assert store.list()[1:] == [version]
