"""Hearing keys of a session, for those who know no transport."""

from __future__ import annotations

from collections.abc import Callable

import zenoh

from twin_daemon.services.recorder import Listen


def listening(session: zenoh.Session) -> Listen:
    """What begins to hear a key of this session, and gives back what ends it."""

    def listen(key: str, take: Callable[[bytes], None]) -> Callable[[], None]:
        subscriber = session.declare_subscriber(key, lambda sample: take(sample.payload.to_bytes()))
        return lambda: subscriber.undeclare()

    return listen
