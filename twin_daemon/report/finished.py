"""Results that `twin diagnose`, `twin ladder` and `twin propose` have written, read back."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError

from twin_daemon.diagnosis.verdict import Diagnosis, LadderResult
from twin_daemon.errors import BadInput
from twin_daemon.proposals.proposal import Proposals

_MOST_BYTES = 64 * 1024 * 1024


Read = TypeVar("Read", Diagnosis, LadderResult, Proposals)


def read_result(path: Path, kind: type[Read], command: str) -> Read:
    """The result in a file that `command` wrote. Raises BadInput with the key that is wrong."""
    todo = f"Write it with {command} --json {path.name}"
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise BadInput("is too large for a result", where=path, todo=todo)
        content = path.read_bytes()
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror})", where=path, todo=todo) from None
    try:
        return kind.model_validate_json(content)
    except ValidationError as error:
        raise BadInput(f"not what {command} writes: {_first(error)}", where=path, todo=todo) from None


def _first(error: ValidationError) -> str:
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"])
    return f"{key}: {first['msg']}" if key else first["msg"]
