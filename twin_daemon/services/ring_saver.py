"""Saves the ring of the last minutes as a recording, when somebody asks for it and the disk has room."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from twin_daemon.daemon.messages import MalformedPayload
from twin_daemon.daemon.settings import DaemonSettings
from twin_daemon.errors import TwinError
from twin_daemon.hand import HandDescription
from twin_daemon.recordings.mcap_file import MESSAGE_OVERHEAD, StreamWriter
from twin_daemon.services.recorder import TOPICS, add_channels, as_joint_state, wall_offset_ns
from twin_daemon.services.ring import Kept, Ring

log = logging.getLogger(__name__)

_MIB = 2**20
_FRAME_BYTES = 16 * 1024  # schema, channels and summary around the messages
_REST_EVERY, _REST_S = 32, 0.0005  # the interpreter is the loop's for most of the time
_CLOSE_S = 15.0
_STATES = "joint_states"
_LEAST_S = 30.0  # less says too little
_BEFORE_S = 1.0


class RingSaver:
    """Writes on the thread of whoever asks, so that the loop goes on meanwhile.

    `recordings_quota_mib` bounds all that `folder` holds. Only what this class wrote itself (kept-*.mcap) may be
    removed to make room, oldest first, and only with `recordings_rotate`.
    """

    def __init__(self, ring: Ring, description: HandDescription, folder: Path, settings: DaemonSettings) -> None:
        self._ring = ring
        self._description = description
        self._folder = folder
        self.retune(settings)
        self._writing = threading.Lock()

    def retune(self, settings: DaemonSettings) -> None:
        """The bounds of the folder from now on."""
        self._quota_bytes = settings.recordings_quota_mib * _MIB
        self._rotate = settings.recordings_rotate

    def close(self) -> None:
        """Lets a recording that is being written end."""
        if self._writing.acquire(timeout=_CLOSE_S):
            self._writing.release()

    def save(self, since_ns: int | None = None) -> dict[str, Any]:
        """Writes what the ring holds, or what of it the hand did since a stamp, but half a minute at least.

        Where it went, or why not; never raises for the disk's sake.
        """
        with self._writing:
            messages = _since(self._ring.messages(), since_ns)
            if not messages:
                off = self._ring.seconds <= 0.0
                return self.refused("keep_minutes is 0: nothing is kept" if off else "nothing has arrived yet")
            path = self._folder / f"kept-{datetime.now(UTC):%Y%m%dT%H%M%S.%f}Z.mcap"
            try:
                self._folder.mkdir(parents=True, exist_ok=True)
                why = self._make_room(sum(len(kept.payload) + MESSAGE_OVERHEAD for kept in messages) + _FRAME_BYTES)
                if why is not None:
                    return self.refused(why)
                counts, size = self._write(path, messages)
            except OSError as error:
                return self.refused(f"{error.filename or self._folder}: {error.strerror}")
            except TwinError as error:
                return self.refused(error.line())
        log.info("kept the last %.0f s as %s", _span_s(messages), path)
        return self._answer(
            messages, kept=True, path=str(path), bytes=size, messages=counts.total(), topics=dict(counts)
        )

    def _write(self, path: Path, messages: list[Kept]) -> tuple[Counter[str], int]:
        """Messages by topic, and the size of the file."""
        file = StreamWriter(path)
        counts: Counter[str] = Counter(dict.fromkeys(TOPICS.values(), 0))
        try:
            channels, offset_ns = add_channels(file, self._description), wall_offset_ns()
            for number, kept in enumerate(messages):
                if number % _REST_EVERY == 0:
                    time.sleep(_REST_S)
                stamp_ns, payload = kept.stamp_ns, kept.payload
                if kept.stream == "residual":
                    try:
                        stamp_ns, payload = as_joint_state(kept.stream, payload)
                    except MalformedPayload:
                        continue
                file.write(channels[kept.stream], offset_ns + round(kept.arrival_s * 1e9), stamp_ns, payload)
                counts[TOPICS[kept.stream]] += 1
            file.finish()
        except BaseException:
            file.discard()  # the ring still has it all
            raise
        return counts, file.bytes

    def _make_room(self, need_bytes: int) -> str | None:
        """Why there is no room for so many bytes; None when there is, after rotation where that is allowed."""
        sizes = {path: _size(path) for path in self._folder.rglob("*")}
        over_bytes = sum(sizes.values()) + need_bytes - self._quota_bytes
        ours = sorted(self._folder.glob("kept-*.mcap")) if self._rotate else []
        leave: list[Path] = []
        for path in ours:  # the names sort by time
            if over_bytes <= 0:
                break
            over_bytes -= sizes.get(path, 0)
            leave.append(path)
        if over_bytes > 0:
            used, quota = sum(sizes.values()) / _MIB, self._quota_bytes / _MIB
            todo = "or raise it" if self._rotate else "raise it, or set recordings_rotate"
            return (
                f"{self._folder} holds {used:.1f} MiB and {need_bytes / _MIB:.1f} MiB more would exceed "
                f"recordings_quota_mib ({quota:.0f}): remove recordings, {todo}"
            )
        for path in leave:
            path.unlink(missing_ok=True)
            log.info("removed %s to make room (recordings_rotate)", path)
        return None

    def refused(self, why: str) -> dict[str, Any]:
        """The answer where nothing is written, and why."""
        return self._answer(self._ring.messages(), kept=False, why=why)

    def _answer(self, held: list[Kept], **rest: Any) -> dict[str, Any]:
        return {
            "schema": 1,
            "hand": self._description.name,
            "namespace": self._description.namespace,
            "kept": False,
            "why": None,
            "path": None,
            "seconds": _span_s(held),
            "messages": len(held),
            "bytes": sum(len(kept.payload) for kept in held),
            "limited_by": "keep_mib" if self._ring.full else "keep_minutes",
            **rest,
        }


def _since(messages: list[Kept], since_ns: int | None) -> list[Kept]:
    """The messages from the first joint state of a stamp on, and the commands that it began with."""
    if since_ns is None or not messages:
        return messages
    begun_s = next((m.arrival_s for m in messages if m.stream == _STATES and m.stamp_ns >= since_ns), math.inf)
    begun_s = min(begun_s, messages[-1].arrival_s - _LEAST_S) - _BEFORE_S
    return [message for message in messages if message.arrival_s >= begun_s]


def _span_s(messages: list[Kept]) -> float:
    # what the twin sent may stand before what arrived while it computed
    return max(messages[-1].arrival_s - messages[0].arrival_s, 0.0) if messages else 0.0


def _size(path: Path) -> int:
    try:
        return path.stat().st_size if path.is_file() else 0
    except FileNotFoundError:  # finished and renamed, or removed, between two looks
        return 0
