"""The question `keep`: whoever asks it has the last minutes saved."""

from __future__ import annotations

import json
import logging

import zenoh

from twin_daemon.hand import HandDescription
from twin_daemon.services.ring_saver import RingSaver

log = logging.getLogger(__name__)


class KeepQuestion:
    """Answers on the transport's own thread. Opened before the bridge: its liveliness token says that all is there."""

    def __init__(self, session: zenoh.Session, description: HandDescription, saver: RingSaver) -> None:
        self._saver = saver
        self._key = description.key("keep")
        self._question = session.declare_queryable(self._key, self._reply)

    def _reply(self, query: zenoh.Query) -> None:
        try:
            with query:
                # to ask for everything below a namespace is to look, and looking must not fill the disk
                looked = str(query.key_expr) != self._key
                wildcard = "asked with a wildcard; ask for the key itself"
                answer = self._saver.refused(wildcard) if looked else self._saver.save()
                query.reply(self._key, json.dumps(answer, allow_nan=False), encoding="application/json")
        except Exception as error:
            log.warning("the answer to keep failed: %r", error)

    def close(self) -> None:
        """Withdraws the question."""
        self._question.undeclare()
