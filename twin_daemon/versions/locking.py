"""One writer at a time, and what the machine refuses in words."""

from __future__ import annotations

import errno
import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from twin_daemon.errors import BadInput, NoAnswer
from twin_daemon.files import make_folder

LOCK = ".lock"
_LOCK_WAIT_S = 30.0
NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
NOT_WRITABLE = (errno.EROFS, errno.EACCES, errno.EPERM)
_SAFE = "what was stored before is untouched"


@contextmanager
def locked(root: Path) -> Iterator[None]:
    """Alone among the writers of a hand's folder. The kernel gives the lock back when a writer dies.

    Raises NoAnswer after half a minute of waiting, BadInput where the disk is full or cannot be written.
    """
    with machine_errors(root):
        make_folder(root)
        handle = _acquire(root)
    try:
        yield
    finally:
        os.close(handle)


@contextmanager
def machine_errors(root: Path) -> Iterator[None]:
    """A full or read-only disk as an error for people."""
    try:
        yield
    except OSError as error:
        if error.errno in NO_SPACE:
            todo = f"Free space ('twin versions prune' frees some; {_SAFE})"
            raise BadInput("no space is left for versions", where=root, todo=todo) from error
        if error.errno in NOT_WRITABLE:
            todo = f"Make it writable, or choose another place with TWIN_STATE_DIR ({_SAFE})"
            raise BadInput(f"versions cannot be written here ({error.strerror})", where=root, todo=todo) from error
        raise


def _acquire(root: Path) -> int:
    deadline = time.monotonic() + _LOCK_WAIT_S
    while True:
        handle = os.open(root / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _still_there(handle, root / LOCK):  # not of a folder that a restore has replaced since
                return handle
        except BlockingIOError:
            if time.monotonic() > deadline:
                os.close(handle)
                raise NoAnswer(
                    "another process has been writing versions for too long", where=root, todo="End it and try again"
                ) from None
        os.close(handle)
        time.sleep(0.01)


def _still_there(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False
