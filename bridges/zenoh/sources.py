"""Who published a message, as far as the network tells: Zenoh's source of a sample, ROS 2's writer, or a timestamp's.

A name that a message carries can be forged by whoever may publish it. Access control says who may; this is for the
second driver, the forgotten replay and the copy, which nobody meant to be there.
"""

from __future__ import annotations

import itertools
from typing import Any

import zenoh

from twin_daemon.daemon.messages import ROS_SOURCE

_GID = b"source_gid"
_GID_BYTES = 16
_BY = b"by:"
_MOST_WORDS = 200


class Speaker:
    """A publisher that says with each message who it is."""

    def __init__(self, publisher: zenoh.Publisher) -> None:
        self._publisher = publisher
        self._id = publisher.id
        self._numbers = itertools.count()
        self.source = _entity(self._id)

    def put(self, payload: bytes, by: str = "") -> None:
        """Publishes; `by` says in words for whom, where it passes on what others have said."""
        number = next(self._numbers) % 2**32
        attached = _BY + by.encode() if by else None
        self._publisher.put(payload, attachment=attached, source_info=zenoh.SourceInfo(self._id, number))

    @property
    def is_heard(self) -> bool:
        """Whether somebody listens. The stubs of the binding call the status a bool; it is an object that holds one."""
        status = self._publisher.matching_status
        return bool(getattr(status, "matching", status))

    def undeclare(self) -> None:
        self._publisher.undeclare()


class Sources:
    """Tells the sources of one session's samples apart, and names them for people. Safe in several threads."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._stampers: dict[str, bool] = {}

    def of(self, sample: zenoh.Sample) -> str:
        """The source of a sample, after a space in words for whom it speaks, if it says so; "" where nothing tells."""
        info = sample.source_info
        attached = b"" if sample.attachment is None else sample.attachment.to_bytes()
        if info is not None:
            return f"{_entity(info.source_id)} {_words(attached)}".rstrip()
        if writer := _ros_writer(attached):
            return writer
        stamp = sample.timestamp
        return "" if stamp is None else self._stamped_by(str(stamp.get_id()))

    def _stamped_by(self, stamper: str) -> str:
        """A router stamps what comes without a timestamp: its id says nothing about who published."""
        known = self._stampers.get(stamper)
        if known is None:
            info = self._session.info
            known = stamper in {str(one) for one in (info.zid(), *info.routers_zid())}
            if len(self._stampers) > 1000:  # ids are free to invent
                self._stampers.clear()
            self._stampers[stamper] = known
        return "" if known else stamper

    def named(self, source: str) -> str:
        """A source in words: its address and login, where it is connected to this session itself."""
        if not source:
            return "a publisher that does not say who it is"
        source, _, words = source.partition(" ")
        if words:
            return f"{words}, through {self.named(source)}"
        zid = source.removeprefix(ROS_SOURCE).partition("/")[0]
        if source.startswith(ROS_SOURCE):
            return f"the ROS 2 writer {zid}" if zid else "a ROS 2 writer"
        for link in self._session.info.links():
            if str(link.zid) == zid:
                login = f" as {link.auth_identifier}" if link.auth_identifier else ""
                return f"{link.dst}{login} (Zenoh session {zid[:8]})"
        return f"Zenoh session {zid[:8]}"


def _entity(entity: Any) -> str:
    return f"{entity.zid}/{entity.eid}"


def _words(attachment: bytes) -> str:
    """What a speaker says of those for whom it speaks; "" for any other attachment."""
    if not attachment.startswith(_BY):
        return ""
    said = attachment.removeprefix(_BY)[:_MOST_WORDS].decode(errors="replace")
    return "".join(letter if letter.isprintable() else "?" for letter in said)


def _ros_writer(attachment: bytes) -> str:
    """The writer's id that rmw_zenoh attaches to each message; "" for any other attachment."""
    gid = attachment.rpartition(_GID)[2] if _GID in attachment else b""
    return gid[-_GID_BYTES:].hex() if len(gid) in (_GID_BYTES, _GID_BYTES + 1) else ""
