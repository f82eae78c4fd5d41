"""Whatever goes wrong is an exit code and one line."""

from __future__ import annotations

import errno
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from twin_daemon.cli.app import main
from twin_daemon.cli.command import single
from twin_daemon.cli.failures import guarded
from twin_daemon.errors import BadInput, NoAnswer, Refused


def run(raised: BaseException) -> int:
    def command() -> None:
        raise raised

    return guarded(single("try", command), [])


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    return captured.err


@pytest.mark.parametrize(
    ("error", "code"),
    [(BadInput("no\nsuch file", where="x.bag"), 3), (Refused("too fast"), 4), (NoAnswer("nobody there"), 5)],
)
def test_errors_for_people_are_one_line(error: Exception, code: int, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(error) == code
    assert str(error) in one_line(capsys)


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["vesions"], "Did you mean 'versions'?"),
        ([], "twin --help"),
        (["--nonsense"], "--nonsense"),
        (["versions", "lst"], "Did you mean 'list'?"),
        (["versions", "diff", "a"], "twin versions diff --help"),
    ],
)
def test_wrong_usage_is_one_line_with_a_hint(argv: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(argv) == 2
    assert said in one_line(capsys)


def test_a_bug_is_told_and_its_details_are_kept(state_dir: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(RuntimeError("[odd]\nstate")) == 1
    line = one_line(capsys)
    (log,) = (state_dir / "log").iterdir()
    assert str(log) in line
    assert "RuntimeError: [odd] state" in line
    assert "Traceback" in log.read_text(encoding="utf-8")


def test_a_developer_sees_the_bug_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TWIN_DEBUG", "1")
    with pytest.raises(RuntimeError, match="odd"):
        run(RuntimeError("odd"))


def test_an_interrupt_is_130_and_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(KeyboardInterrupt()) == 130
    assert capsys.readouterr() == ("", "")


def test_a_full_disk_is_not_a_bug(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(OSError(errno.ENOSPC, "No space left on device", "out.json")) == 3
    assert "out.json: no space is left" in one_line(capsys)


def test_what_a_command_returns_is_the_exit_code() -> None:
    returns: Callable[[], int] = lambda: 3  # noqa: E731
    assert guarded(single("try", returns), []) == 3


def test_a_reader_that_goes_away_is_no_error() -> None:
    code = (
        "import sys\n"
        "from twin_daemon.cli.command import single\n"
        "from twin_daemon.cli.failures import guarded\n"
        "def command(): sys.stdout.write('line\\n' * 100_000)\n"
        "sys.exit(guarded(single('try', command), []))\n"
    )
    child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert child.stdout is not None
    assert child.stderr is not None
    child.stdout.readline()
    child.stdout.close()
    said = child.stderr.read()
    child.stderr.close()
    child.wait()
    assert said == b""
