"""Where results go: tables for people, one JSON object for programs."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_daemon.errors import BadInput
from twin_daemon.files import write_atomically
from twin_daemon.jsonable import plain

if TYPE_CHECKING:
    from rich.console import Console

STANDARD_OUTPUT = "-"
SCHEMA = 1


def people(json_path: str | Path | None = None) -> Console:
    """The console for people: standard output, or standard error when the JSON takes standard output."""
    from rich.console import Console

    return Console(stderr=str(json_path) == STANDARD_OUTPUT, highlight=False)


def plain_text(text: object) -> str:
    """A name that came from a file, made safe to stand in rich markup ('[red]' stays as written)."""
    from rich.markup import escape

    return escape(str(text))


def emit_json(path: str | Path | None, result: Any) -> None:
    """Write one object with "schema": 1 to `path` ('-' is standard output; None writes nothing).

    Numbers that are not finite become null. A file is written whole or not at all.
    """
    if path is None:
        return
    value = plain(result)
    if not isinstance(value, dict):
        raise TypeError(f"a result is one JSON object, not {type(result).__name__}")
    text = json.dumps({"schema": SCHEMA, **value}, allow_nan=False, ensure_ascii=False, indent=2) + "\n"
    if str(path) == STANDARD_OUTPUT:
        sys.stdout.write(text)
        return
    target = Path(path)
    if not target.absolute().parent.is_dir():
        raise BadInput(
            "the folder for the JSON does not exist", where=target, todo=f"Create {target.parent} or name another path"
        )
    write_atomically(target, text.encode())


def counted(count: int, word: str) -> str:
    """A number with its word, which has an s unless it is one."""
    return f"{count} {word}" if count == 1 else f"{count} {word}s"


def require_folder(*paths: str | Path | None) -> None:
    """Raises BadInput where a result could not be written, before any work is done for it or anything is stored."""
    for path in paths:
        if path is not None and str(path) != STANDARD_OUTPUT and not Path(path).absolute().parent.is_dir():
            raise BadInput(
                "the folder does not exist", where=path, todo=f"Create {Path(path).parent} or name another path"
            )
