"""What root does in folders of others is done with their rights alone.

Whoever owns a folder decides what its names mean: a link that he plants there would lead root anywhere. So a command
of root works as the owner of the state folder, and takes root's rights again only for files on whose way nobody else
could have put a link.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from twin_daemon.errors import BadInput

_MOST_BYTES = 2**20


def owner_on_the_way(path: Path) -> tuple[int, int] | None:
    """(user, group) of the first folder or link on the way to `path` that is not root's: he says what is there.

    None where all of the way is root's, or where nothing is there but root's folders.
    """
    here = Path(path.anchor or "/")
    for part in Path(os.path.abspath(path)).parts[1:]:  # noqa: PTH100 - links are looked at, not followed
        here /= part
        try:
            found = here.lstat()
        except OSError:
            return None
        if found.st_uid != 0:
            return found.st_uid, found.st_gid
        if stat.S_ISLNK(found.st_mode):  # root's own: what it leads to is looked at in its place
            return owner_on_the_way(here.resolve())
    return None


def work_as_owner(folder: Path) -> None:
    """Gives up root's rights for those of the owner on the way to `folder`; nothing where that is root himself, or
    where this is not root. `as_root` takes them again for a moment. Raises BadInput where the owner cannot work.
    """
    owner = owner_on_the_way(folder) if os.geteuid() == 0 else None
    if owner is None:
        return
    os.setgroups([owner[1]])
    os.setegid(owner[1])
    os.seteuid(owner[0])
    library = Path(os.__file__)
    if not os.access(library, os.R_OK, effective_ids=True):
        raise BadInput(
            f"the user {owner[0]}, whose folder this is and as whom root works here, cannot read {library.parent}",
            where=folder,
            todo="Install the program with a Python that everybody may read, such as the system's",
        )


@contextmanager
def as_root(path: Path) -> Iterator[None]:
    """With root's rights where they were given up, and only where nobody but root decides what `path` is."""
    user, group, groups = os.geteuid(), os.getegid(), os.getgroups()
    if not gave_up_root():
        yield
        return
    os.seteuid(0)
    try:
        if owner_on_the_way(path) is None:
            os.setegid(0)
            os.setgroups([])
        else:
            os.seteuid(user)
        yield
    finally:
        os.seteuid(0)
        os.setgroups(groups)
        os.setegid(group)
        os.seteuid(user)


def gave_up_root() -> bool:
    """Whether this is root, who works as somebody else."""
    return os.getuid() == 0 and os.geteuid() != 0


def read_regular(path: Path, owners: tuple[int, ...]) -> bytes | None:
    """The bytes of a regular file of one of these users, never through a link at its name; None where there is none.

    Raises BadInput for anything else that is there.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise BadInput(f"no plain file ({error.strerror})", where=path, todo="Look at who put it there") from None
    with os.fdopen(handle, "rb") as file:
        found = os.fstat(file.fileno())
        if not stat.S_ISREG(found.st_mode) or found.st_uid not in owners or found.st_size > _MOST_BYTES:
            raise BadInput("no plain file of its folder's owner", where=path, todo="Look at who put it there")
        return file.read(_MOST_BYTES)
