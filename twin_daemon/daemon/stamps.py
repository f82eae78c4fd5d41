"""Stamps must move forward. A clock that was really set back is believed once it has proved itself."""

from __future__ import annotations

from typing import Literal

Verdict = Literal["ok", "duplicate_stamp", "backwards_stamp", "restarted"]


class StampOrder:
    """Accepts strictly increasing stamps.

    A message that was overtaken is refused. A whole stream that starts again at an earlier time (a replayed
    recording, a clock set back, one stray stamp from the future) is accepted after `proof` messages that increase
    among themselves: two sources that alternate never get there.
    """

    def __init__(self, proof: int = 10) -> None:
        self._proof = proof
        self._last_ns: int | None = None
        self._candidate_ns: int | None = None
        self._in_row = 0

    @property
    def last_ns(self) -> int:
        """The latest stamp that was accepted; 0 before the first."""
        return self._last_ns or 0

    def judge(self, stamp_ns: int) -> Verdict:
        """What to do with a message of this stamp. 'restarted' is accepted, and what was known before is void."""
        if self._last_ns is None or stamp_ns > self._last_ns:
            self._accept(stamp_ns)
            return "ok"
        if stamp_ns == self._last_ns:
            return "duplicate_stamp"
        forward = self._candidate_ns is None or stamp_ns > self._candidate_ns
        self._in_row = self._in_row + 1 if forward else 1
        self._candidate_ns = stamp_ns
        if self._in_row < self._proof:
            return "backwards_stamp"
        self._accept(stamp_ns)
        return "restarted"

    def _accept(self, stamp_ns: int) -> None:
        self._last_ns = stamp_ns
        self._candidate_ns = None
        self._in_row = 0
