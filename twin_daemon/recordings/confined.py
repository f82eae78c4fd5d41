"""Recordings of a folder that others may write to: regular files in it are read, and never what a link leads to.

Names in such a folder may change between looking and opening. So the files are opened first, without following links,
looked at as what was opened, and read through these descriptors alone.
"""

from __future__ import annotations

import contextlib
import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

from twin_daemon.errors import BadInput
from twin_daemon.recordings.csv_pair import JOINT_LIST

MOST_FILES = 1000
_OPEN = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC


@contextlib.contextmanager
def confined(path: Path) -> Iterator[Path]:
    """A private path of the same name, behind which are the regular files of the recording at `path`, opened.

    Raises BadInput for a link, a pipe or a device in place of any of them, and where they were replaced meanwhile.
    """
    with contextlib.ExitStack() as stack:
        private = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="twin-recording-")))
        above = _opened(path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC, None, stack)
        held = private / "in" / path.name
        held.parent.mkdir()
        handle = _opened(path, _OPEN, above, stack)
        folder = stat.S_ISDIR(os.fstat(handle).st_mode)
        if folder:
            held.mkdir()
            names = sorted(os.listdir(handle))  # noqa: PTH208 - of the folder that was opened
            if len(names) > MOST_FILES:
                raise BadInput(f"this folder has {len(names)} files", where=path, allowed=f"up to {MOST_FILES}")
            for name in names:
                _link(path / name, held / name, handle, stack)
            if _is_there(JOINT_LIST, above):  # of a pair of CSV files it may be in the folder above
                _link(path.parent / JOINT_LIST, held.parent / JOINT_LIST, above, stack)
        else:
            _require_file(handle, path)
            held.symlink_to(f"/proc/self/fd/{handle}")
        yield held
        now = os.stat(path.name, dir_fd=above, follow_symlinks=False) if _is_there(path.name, above) else None
        if now is None or not os.path.samestat(now, os.fstat(handle)):
            raise BadInput("was replaced while it was read", where=path, todo="Open it again")


def _link(path: Path, target: Path, folder: int, stack: contextlib.ExitStack) -> None:
    handle = _opened(path, _OPEN, folder, stack)
    if stat.S_ISDIR(os.fstat(handle).st_mode):
        return  # nothing of a recording is in folders of its folder
    _require_file(handle, path)
    target.symlink_to(f"/proc/self/fd/{handle}")


def _opened(path: Path, flags: int, folder: int | None, stack: contextlib.ExitStack) -> int:
    try:
        handle = os.open(path if folder is None else path.name, flags, dir_fd=folder)
    except OSError as error:
        if path.is_symlink() and flags & os.O_NOFOLLOW:
            raise BadInput("is a link, and what it leads to is not read", where=path, todo="Copy the file") from None
        raise BadInput(f"cannot be read ({error.strerror})", where=path) from None
    stack.callback(os.close, handle)
    return handle


def _require_file(handle: int, path: Path) -> None:
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        raise BadInput("not a file (a device or a pipe)", where=path)


def _is_there(name: str, folder: int) -> bool:
    try:
        os.stat(name, dir_fd=folder, follow_symlinks=False)
    except OSError:
        return False
    return True
