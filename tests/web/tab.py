"""What a test does with a page, whichever browser shows it."""

from __future__ import annotations

import itertools
import json
import time
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection

# The middle of an element where a pointer would reach it, else nothing: it may be hidden, disabled or covered.
_REACHED = """((one) => {
  if (!one || one.disabled || !one.checkVisibility()) return null;
  one.scrollIntoView({ block: "nearest", inline: "nearest" });
  const box = one.getBoundingClientRect(), x = box.x + box.width / 2, y = box.y + box.height / 2;
  const top = document.elementFromPoint(x, y);
  return top && (top === one || one.contains(top)) ? [x, y] : null;
})"""


class Left(AssertionError):
    """The page went while it was asked."""


class Tab(ABC):
    """One page: runs expressions in it, waits for them to become true, and keeps what its console said."""

    def __init__(self, socket: ClientConnection, answer_s: float) -> None:
        """`answer_s` is how long the browser may take for an answer."""
        self.console: list[str] = []
        self._socket, self._answer_s = socket, answer_s
        self._numbers = itertools.count(1)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """What the browser answers to a method of its protocol. Left where the page went meanwhile."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        deadline_s = time.monotonic() + self._answer_s
        while True:
            told = json.loads(self._socket.recv(timeout=max(deadline_s - time.monotonic(), 0.01)))
            if told.get("id") == number:
                self._check(method, told)
                return told["result"]
            self._note(told)

    @abstractmethod
    def _check(self, method: str, answer: dict[str, Any]) -> None:
        """Raises Left or AssertionError where an answer is an error."""

    @abstractmethod
    def _note(self, event: dict[str, Any]) -> None:
        """Keeps what an event says."""

    @abstractmethod
    def before_each_page(self, script: str) -> None:
        """Runs a script in every page that is opened from now on, before the page's own."""

    @abstractmethod
    def go(self, address: str) -> None: ...

    @abstractmethod
    def reload(self) -> None: ...

    @abstractmethod
    def run(self, expression: str) -> Any:
        """The value of an expression; a promise is waited for."""

    @abstractmethod
    def key(self, key: str) -> None:
        """Strikes one key, by its name in the browser: 'a', 'Enter', 'ArrowLeft'."""

    @abstractmethod
    def write(self, text: str) -> None:
        """Types a text where the focus is."""

    @abstractmethod
    def press_at(self, x: float, y: float, held_s: float = 0.0) -> None:
        """A click of the pointer at a point of the page (CSS pixels), its button down for so long."""

    @abstractmethod
    def choose_file(self, path: Path) -> None:
        """Gives a file to the page's own chooser of files, as its dialog would."""

    @abstractmethod
    def screen(self, width: int, height: int) -> None:
        """The size of what shows the page (CSS pixels)."""

    @abstractmethod
    def picture(self, path: Path) -> None: ...

    def close(self) -> None:
        self._socket.close()

    def until(self, expression: str, timeout_s: float = 20.0) -> Any:
        """The first true value of an expression, which may fail while the page is being loaded."""
        guarded = f"(() => {{ try {{ return {expression} }} catch {{ return null }} }})()"
        deadline_s = time.monotonic() + timeout_s
        while not (value := self._try(guarded)):
            assert time.monotonic() < deadline_s, f"not within {timeout_s:g} s: {expression}\n{self.text()[-3000:]}"
            time.sleep(0.1)
        return value

    def _try(self, expression: str) -> Any:
        try:
            return self.run(expression)
        except Left:
            return None

    def text(self) -> str:
        return str(self.run("document.body ? document.body.innerText : ''"))

    def click(self, selector: str) -> None:
        """Clicks as soon as there is something to click, wherever it is."""
        found = f"document.querySelector({json.dumps(selector)})"
        self.until(f"{found} && !{found}.disabled")
        self.run(f"{found}.click()")

    def press(self, selector: str, timeout_s: float = 20.0, held_s: float = 0.0) -> None:
        """A pointer's click on what is on the screen, can be reached there and is not disabled."""
        place = self.until(f"{_REACHED}(document.querySelector({json.dumps(selector)}))", timeout_s)
        self.press_at(*place, held_s)
