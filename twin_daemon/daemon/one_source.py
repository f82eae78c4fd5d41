"""One source of joint states at a time: of two that speak at once the second is not believed, and is named."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

_SILENT_S = 1.0  # after so long without a word the stream may be another source's
_BACK_S = 1.0
_TELL_AGAIN_S = 10.0
_BACK = 3  # one message may be overtaken; so many in that time are another clock


@dataclass(frozen=True)
class Doubt:
    """Why states may not be the hand's. A `serious` one ends what the gate does. `source` and `believed` as the
    transport tells them, "" where it does not; `back_s` is how far stamps went back."""

    kind: Literal["second_source", "source_changed", "backwards"]
    serious: bool
    source: str
    believed: str
    back_s: float = 0.0


class OneSource:
    """Whose states are believed: the first source that spoke, until it is silent for a second."""

    def __init__(self) -> None:
        self.believed: str | None = None
        self._heard_s = 0.0
        self._back: deque[float] = deque(maxlen=_BACK)

    def doubt(self, source: str, now_s: float) -> Doubt | None:
        """What is wrong with a message of this source; only one of kind `second_source` is to be refused."""
        before = self.believed
        if before is not None and source != before:
            if now_s - self._heard_s <= _SILENT_S:
                return Doubt("second_source", True, source, before)
            self.believed, self._heard_s = source, now_s
            return Doubt("source_changed", True, source, before)
        self.believed, self._heard_s = source, now_s
        return None

    def backwards(self, source: str, back_ns: int, now_s: float) -> Doubt:
        """A message of the believed source whose stamp is `back_ns` before the last one."""
        self._back.append(now_s)
        often = len(self._back) == _BACK and now_s - self._back[0] <= _BACK_S
        return Doubt("backwards", often, source, self.believed or "", back_ns * 1e-9)


def in_words(doubt: Doubt, named: Callable[[str], str]) -> str:
    """A doubt for people; `named` says who a source is."""
    if doubt.kind == "backwards":
        often = "again and again: there may be two sources of them" if doubt.serious else "once"
        return f"stamps of the joint states of {named(doubt.source)} went back by {doubt.back_s:.3f} s, {often}"
    if doubt.kind == "source_changed":
        return f"joint states come from {named(doubt.source)} now, and came from {named(doubt.believed)} before"
    return (
        f"a second source of joint states: {named(doubt.source)}, beside {named(doubt.believed)}; the second is not "
        "believed"
    )


class Doubts:
    """Makes events of doubts: each kind at once, then every ten seconds while it goes on."""

    def __init__(self, tell: Callable[[str, str, dict[str, Any]], None]) -> None:
        self._tell = tell
        self._told_s: dict[str, float] = {}

    def tell(self, doubt: Doubt, named: Callable[[str], str], now_s: float) -> None:
        """`named` says who a source is."""
        told_s = self._told_s.get(doubt.kind, float("-inf"))
        if doubt.kind == "source_changed" or now_s - told_s > _TELL_AGAIN_S:
            self._told_s[doubt.kind] = now_s
            data = {"source": doubt.source, "believed": doubt.believed, "back_s": doubt.back_s}
            self._tell(doubt.kind, in_words(doubt, named), data)
