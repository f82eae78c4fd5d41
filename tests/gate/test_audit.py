"""The audit log: appended to, chained, honest about what was torn."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin_daemon.cli.app import main
from twin_daemon.errors import BadInput
from twin_daemon.gate.audit import AuditLog, entries_of, verify


def written(path: Path, count: int) -> None:
    log = AuditLog(path)
    for number in range(count):
        log.write(1000 + number, {"verb": "move", "who": "ann", "accepted": True, "note": "ü" * number})
    log.close()


def test_a_log_goes_on_where_it_ended(tmp_path: Path) -> None:
    path = tmp_path / "audit.jsonl"
    written(path, 3)
    written(path, 2)
    found = verify(path)
    assert (found.entries, found.torn, found.broken) == (5, 0, ())
    assert [entry["number"] for entry in entries_of(path)] == [1, 2, 3, 4, 5]
    assert path.stat().st_mode & 0o077 == 0


@given(st.data())
def test_whatever_is_changed_removed_or_moved_is_noticed(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = tmp_path_factory.mktemp("audit") / "audit.jsonl"
    written(path, 6)
    lines = path.read_bytes().splitlines(keepends=True)
    place = data.draw(st.integers(0, 4))
    change = data.draw(st.sampled_from(["edit", "remove", "swap", "double"]))
    if change == "edit":
        lines[place] = lines[place].replace(b'"ann"', b'"bob"')
    elif change == "remove":
        del lines[place]
    elif change == "swap":
        lines[place], lines[place + 1] = lines[place + 1], lines[place]
    else:
        lines.insert(place, lines[place])
    path.write_bytes(b"".join(lines))
    assert verify(path).broken


@given(cut=st.integers(1, 400))
def test_a_torn_last_line_is_named_by_the_next_and_breaks_nothing(
    tmp_path_factory: pytest.TempPathFactory, cut: int
) -> None:
    path = tmp_path_factory.mktemp("audit") / "audit.jsonl"
    written(path, 4)
    whole = path.read_bytes()
    path.write_bytes(whole[:-cut])
    left = len(list(entries_of(path)))
    assert not verify(path).broken
    written(path, 1)
    after = verify(path)
    assert not after.broken
    assert after.entries == left + 1


def test_a_line_of_rubbish_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "audit.jsonl"
    written(path, 2)
    with path.open("ab") as file:
        file.write(b"what is this\n")
    assert [broken.line for broken in verify(path).broken] == [3]
    with pytest.raises(BadInput, match="audit verify"):
        AuditLog(path)


def test_a_log_that_ends_in_no_entry_is_not_gone_on_with(tmp_path: Path) -> None:
    path = tmp_path / "audit.jsonl"
    path.write_text('{"verb": "move"}\n')
    with pytest.raises(BadInput, match="the last line of the audit log is no entry") as refused:
        AuditLog(path)
    assert "move the file away" in str(refused.value.todo)


def test_an_empty_log_is_whole_and_begun(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "audit.jsonl"
    path.touch()
    assert main(["audit", "verify", str(path)]) == 0
    assert capsys.readouterr().out == "the audit log is empty, and whole\n"
    assert main(["audit", "show", str(path)]) == 0
    assert capsys.readouterr().out == ""
    written(path, 1)
    assert main(["audit", "verify", str(path)]) == 0
    assert capsys.readouterr().out.startswith("1 entry, whole;")


def test_a_full_disk_costs_the_entry_and_not_the_chain(tmp_path: Path) -> None:
    script = """
import resource, signal, sys
from pathlib import Path
from twin_daemon.gate.audit import AuditLog
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
log = AuditLog(Path(sys.argv[1]))
resource.setrlimit(resource.RLIMIT_FSIZE, (2000, resource.RLIM_INFINITY))
failed = 0
for number in range(60):
    try:
        log.write(number, {"verb": "move"})
    except OSError:
        failed += 1
        resource.setrlimit(resource.RLIMIT_FSIZE, (2000 + 200 * failed, resource.RLIM_INFINITY))
print(failed)
"""
    path = tmp_path / "audit.jsonl"
    done = subprocess.run([sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=True)
    failed = int(done.stdout)
    found = verify(path)
    assert failed > 5
    assert (found.entries, found.torn, found.broken) == (60 - failed, 0, ())


def test_a_writer_that_is_killed_leaves_a_chain(tmp_path: Path) -> None:
    path = tmp_path / "audit.jsonl"
    script = (
        "import sys\nfrom pathlib import Path\nfrom twin_daemon.gate.audit import AuditLog\n"
        "log = AuditLog(Path(sys.argv[1]))\nprint('ready', flush=True)\n"
        "while True: log.write(1, {'verb': 'move', 'text': 'x' * 5000})\n"
    )
    for _ in range(5):
        process = subprocess.Popen([sys.executable, "-c", script, str(path)], stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        before = path.stat().st_size
        while path.stat().st_size < before + 50_000:
            os.sched_yield()
        process.send_signal(signal.SIGKILL)
        process.wait()
        process.stdout.close()
    found = verify(path)
    assert not found.broken
    assert found.entries > 50


def test_entries_are_plain_json(tmp_path: Path) -> None:
    path = tmp_path / "audit.jsonl"
    written(path, 1)
    entry = json.loads(path.read_text(encoding="utf-8"))
    assert entry["who"] == "ann"
    assert entry["prev"] == "0" * 64
