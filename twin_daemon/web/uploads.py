"""Recordings that come through the page, in pieces: sized, named and screened before they are offered.

A piece is written only where the last one ended, and one that comes beside it waits for its turn. The file lies in a
folder that is never offered until it is whole; then it is read as every recording of a stranger is. What is none goes
again, and nothing is ever overwritten.
"""

from __future__ import annotations

import hashlib
import os
import re
import secrets
import shutil
import stat
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Route

from twin_daemon.errors import BadInput, Refused
from twin_daemon.web.app import posting
from twin_daemon.web.library import SUFFIXES, Library
from twin_daemon.web.model_cache import ModelCache

PIECE_BYTES = 16 * 1024 * 1024
"""What one request may bring."""
MOST_MB = 4096
"""What one recording may have where nothing else is said."""

_MOST_AT_ONCE = 4
_MOST_PIECES_AT_ONCE = 2  # one is received while the one before it is written
_WAIT_S = 30.0  # for the piece before
_IDLE_S = 600.0
_LEFT_FREE_BYTES = 512 * 1024 * 1024
_FOLDER = ".uploads"
_CREATE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC


@dataclass
class Upload:
    """One file on its way. `has` of its `size` bytes are there."""

    id: str
    name: str
    size: int
    path: Path
    handle: int
    used_s: float
    digest: hashlib._Hash
    """Of the bytes that are there."""
    has: int = 0
    busy: bool = False
    coming: list[int] = field(default_factory=list)
    """Offsets of the pieces whose requests have begun."""


class Uploads:
    """Files on their way into `folder`, of at most `most_mb` each."""

    def __init__(self, folder: Path, library: Library, cache: ModelCache, most_mb: int = MOST_MB) -> None:
        self._folder, self._library, self._cache = folder, library, cache
        self._most = most_mb * 1_000_000
        self._lock = threading.Lock()
        self._turn = threading.Condition(self._lock)
        self._open: dict[str, Upload] = {}

    @property
    def routes(self) -> list[BaseRoute]:
        return [
            posting("/api/upload/begin", self._begin),
            Route("/api/upload/piece", self._piece, methods=["POST"]),
            posting("/api/upload/end", self._end),
            posting("/api/upload/cancel", self._cancel),
        ]

    def close(self) -> None:
        """Forgets what is not whole."""
        with self._lock:
            left, self._open = list(self._open.values()), {}
        for one in left:
            _forget(one)

    def _begin(self, body: dict[str, Any]) -> dict[str, Any]:
        name, size = plain_name(str(body.get("name", ""))), body.get("bytes")
        if not isinstance(size, int) or isinstance(size, bool) or size <= 0:
            raise BadInput(f"{size!s:.40} bytes", where=name, allowed="a whole number above 0")
        if size > self._most:
            todo = "Start the workbench with a larger --most-upload, or copy the file into the folder of recordings"
            raise BadInput(
                f"{size / 1e6:.0f} MB are too many", where=name, allowed=f"up to {self._most / 1e6:.0f} MB", todo=todo
            )
        with self._lock:
            for old in [one for one in self._open.values() if time.monotonic() - one.used_s > _IDLE_S]:
                _forget(self._open.pop(old.id))
            if len(self._open) >= _MOST_AT_ONCE:
                raise Refused(f"{_MOST_AT_ONCE} files are on their way already", todo="Wait until one has arrived")
            folder = self._folder / _FOLDER
            try:
                folder.mkdir(mode=0o700, parents=True, exist_ok=True)
                told = folder.lstat()
                if not stat.S_ISDIR(told.st_mode) or told.st_uid != os.geteuid():
                    raise BadInput("is not this workbench's own folder", where=folder, todo="Remove it, and try again")
                on_their_way = sum(one.size - one.has for one in self._open.values())
                if shutil.disk_usage(folder).free - on_their_way < size + _LEFT_FREE_BYTES:
                    raise BadInput("the disk has no room for it", where=folder, todo="Make room, then drop it again")
                number = secrets.token_hex(16)
                path = folder / number
                handle = os.open(path, _CREATE, 0o600)
            except OSError as error:
                raise BadInput(f"nothing can be written there ({error.strerror})", where=folder) from None
            self._open[number] = Upload(number, name, size, path, handle, time.monotonic(), hashlib.sha256())
        return {"id": number, "name": name, "piece_bytes": PIECE_BYTES}

    async def _piece(self, request: Request) -> Response:
        """The body is what comes at `offset`; the answer says how much is there."""
        query = request.query_params
        text, number = query.get("offset", ""), query.get("id", "")
        offset = int(text) if text.isdecimal() and len(text) < 16 else -1
        with self._coming(number, offset):
            content = bytearray()
            async for part in request.stream():
                content += part
                if len(content) > PIECE_BYTES:
                    raise BadInput(f"the piece is larger than {PIECE_BYTES} bytes")
            has = await run_in_threadpool(self._written, number, offset, content)
        return JSONResponse({"has": has})

    @contextmanager
    def _coming(self, number: str, offset: int) -> Iterator[None]:
        """While a piece is on its way those behind it wait for it; they wait no longer once it is written or lost."""
        with self._lock:
            one = self._open.get(number)
            coming = [] if one is None else one.coming
            if len(coming) >= _MOST_PIECES_AT_ONCE:
                raise Refused(f"{_MOST_PIECES_AT_ONCE} pieces of it are on their way", todo="Wait for the first")
            coming.append(offset)
        try:
            yield
        finally:
            with self._turn:
                coming.remove(offset)
                self._turn.notify_all()

    def _written(self, number: str, offset: int, content: bytearray) -> int:
        one = self._taken(number, offset)
        try:
            if offset != one.has:
                raise BadInput(f"the piece begins at byte {offset}", where=one.name, allowed=str(one.has))
            if one.has + len(content) > one.size:
                raise BadInput(f"more bytes than the {one.size} that were announced", where=one.name)
            written, whole = 0, memoryview(content)
            while written < len(content):
                written += os.pwrite(one.handle, whole[written:], offset + written)
            one.digest.update(content)
            one.has += len(content)
            return one.has
        except OSError as error:
            raise BadInput(f"cannot be written ({error.strerror})", where=one.name) from None
        finally:
            with self._turn:
                one.busy, one.used_s = False, time.monotonic()
                self._turn.notify_all()

    def _end(self, body: dict[str, Any]) -> dict[str, Any]:
        """Screens what has arrived and offers it. Raises BadInput, and forgets it, where it is no recording."""
        one = self._taken(str(body.get("id", "")))
        if one.has != one.size:
            one.busy = False
            raise BadInput(f"{one.has} of {one.size} bytes are there", where=one.name, todo="Send the rest first")
        with self._lock:
            self._open.pop(one.id, None)
        screened = one.path.with_name(f"{one.id}-{one.name}")
        try:
            one.path.rename(screened)
            with ThreadPoolExecutor(1, thread_name_prefix="twin-upload-sync") as beside:
                synced = beside.submit(os.fsync, one.handle)
                try:
                    aligned = self._cache.screen(screened, one.digest.hexdigest())
                except BadInput as error:
                    raise BadInput(error.what, where=one.name, allowed=error.allowed, todo=error.todo) from None
                synced.result()
            told = os.fstat(one.handle)
            final = self._placed(screened, one.name)
        except OSError as error:
            raise BadInput(f"cannot be kept ({error.strerror})", where=one.name) from None
        finally:
            screened.unlink(missing_ok=True)
            _forget(one)
        self._cache.adopt(aligned, final, told)
        return {"name": final.name, "id": self._library.offer_id(final)}

    def _placed(self, screened: Path, name: str) -> Path:
        """Links it to a name that nobody has; what is there stays."""
        for attempt in range(1, 1000):
            stem, dot, suffix = name.partition(".")
            target = self._folder / (name if attempt == 1 else f"{stem}-{attempt}{dot}{suffix}")
            try:
                os.link(screened, target, follow_symlinks=False)
            except FileExistsError:
                continue
            return target
        raise BadInput("this name is taken a thousand times", where=name, todo="Give it another one")

    def _cancel(self, body: dict[str, Any]) -> dict[str, Any]:
        one = self._taken(str(body.get("id", "")))
        with self._lock:
            self._open.pop(one.id, None)
        _forget(one)
        return {}

    def _taken(self, number: str, offset: int = 0) -> Upload:
        """The upload, for this request alone; a piece for an `offset` ahead waits for those that come before it."""

        def mine() -> bool:
            one = self._open.get(number)
            return one is None or offset <= one.has or not (one.busy or any(other < offset for other in one.coming))

        with self._turn:
            self._turn.wait_for(mine, _WAIT_S)
            one = self._open.get(number)
            if one is None:
                raise BadInput("this file is not on its way", todo="Drop it again")
            if one.busy:
                raise Refused("a piece of it is being written", todo="Send one piece after the other")
            one.busy = True
            return one


def plain_name(name: str) -> str:
    """A file name of letters, digits and `_.-` alone, with an end that recordings have. Raises BadInput."""
    plain = re.sub(r"[^A-Za-z0-9_.-]+", "_", name.replace("\\", "/").rpartition("/")[2]).lstrip(".")
    suffix = next((end for end in SUFFIXES if plain.lower().endswith(end)), None)
    if suffix is None or len(plain) == len(suffix):
        raise BadInput(f"'{name:.80}' is no recording by its name", allowed=", ".join(SUFFIXES))
    stem = plain[: -len(suffix)]
    return stem[:80] + suffix


def _forget(one: Upload) -> None:
    try:
        os.close(one.handle)
    finally:
        one.path.unlink(missing_ok=True)
