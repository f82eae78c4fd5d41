"""From what went wrong to an exit code and one line on standard error.

0 done, 1 a bug of this program, 2 wrong usage, 3 bad input, 4 refused by the safety gate, 5 nothing answered,
130 interrupted.
"""

from __future__ import annotations

import errno
import os
import sys
import tempfile
import traceback
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import typer
from typer.exceptions import TyperException

from twin_daemon.errors import BadInput, TwinError
from twin_daemon.resources import state_dir

INTERRUPTED = 130

# What the machine refuses is for the person to mend; it is not a bug of this program.
_MACHINE = {
    errno.EACCES: "permission denied",
    errno.EPERM: "permission denied",
    errno.EROFS: "the file system is read-only",
    errno.ENOSPC: "no space is left on the disk",
    errno.EDQUOT: "the disk quota is used up",
}


def guarded(command: Any, argv: Sequence[str] | None = None) -> int:
    """Run a command. What its function returns as an int is the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        result = command.main(arguments, prog_name="twin", standalone_mode=False)
        sys.stdout.flush()
        return result if isinstance(result, int) else 0
    except TwinError as error:
        return _say(error.line(), error.exit_code)
    except TyperException as error:
        return _wrong_usage(error)
    except (KeyboardInterrupt, typer.Abort):
        return INTERRUPTED  # whoever pressed the key knows
    except BrokenPipeError:
        # The reader has gone (`twin ... | head`). Python flushes once more at its end: give it somewhere to write.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        if error.errno not in _MACHINE:
            return _bug(error)
        refused = BadInput(
            _MACHINE[error.errno], where=error.filename, todo="Free space or choose another place (TWIN_STATE_DIR)"
        )
        return _say(refused.line(), refused.exit_code)
    except Exception as error:
        return _bug(error)


def _say(line: str, exit_code: int) -> int:
    print(line, file=sys.stderr, flush=True)
    return exit_code


def _wrong_usage(error: TyperException) -> int:
    context = getattr(error, "ctx", None)
    path = context.command_path if context else "twin"
    if context is not None and not error.format_message().strip():
        print(context.get_help(), file=sys.stderr)
        return error.exit_code
    message = " ".join(error.format_message().split()).rstrip(".")
    closing = "" if message.endswith(("?", "!")) else "."
    return _say(f"{path}: {message}{closing} See '{path} --help'.", 2)


def _bug(error: Exception) -> int:
    if os.environ.get("TWIN_DEBUG") == "1":
        raise error
    what = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    return _say(f"A bug in twin_daemon stopped this command ({what}). The details are in {_write_traceback(error)}.", 1)


def _write_traceback(error: Exception) -> Path:
    name = f"bug-{datetime.now(UTC):%Y%m%dT%H%M%S}-{os.getpid()}.txt"
    text = f"twin {' '.join(sys.argv[1:])}\n\n" + "".join(traceback.format_exception(error))
    for folder in (state_dir() / "log", Path(tempfile.gettempdir())):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with (folder / name).open("x", encoding="utf-8") as file:  # never through a link that is there already
                file.write(text)
            return folder / name
        except OSError:
            continue
    return Path("(nowhere: no folder could be written)")
