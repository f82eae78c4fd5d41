"""A real headless Firefox, driven by WebDriver BiDi: the protocol that browsers share."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

from tests.web.tab import Left, Tab

_START_S = 60.0
_ANSWER_S = 60.0
_KEYS = {
    "Enter": "\ue007", "Tab": "\ue004", "Escape": "\ue00c", "ArrowLeft": "\ue012", "ArrowUp": "\ue013",
    "ArrowRight": "\ue014", "ArrowDown": "\ue015", "End": "\ue010",
}  # fmt: skip
# It asks nobody but this machine, and says nothing of itself.
_PREFERENCES = {
    "app.update.enabled": False, "browser.shell.checkDefaultBrowser": False, "browser.startup.page": 0,
    "datareporting.policy.dataSubmissionEnabled": False, "toolkit.telemetry.enabled": False,
    "services.settings.server": "data:,none", "network.captive-portal-service.enabled": False,
    "network.connectivity-service.enabled": False, "browser.safebrowsing.downloads.enabled": False,
    "browser.safebrowsing.malware.enabled": False, "browser.safebrowsing.phishing.enabled": False,
    "extensions.update.enabled": False, "network.dns.disablePrefetch": True, "webgl.force-enabled": True,
    "network.proxy.type": 0, "app.normandy.enabled": False, "browser.newtabpage.enabled": False,
}  # fmt: skip


def firefox() -> str | None:
    """The browser of this machine."""
    return next(filter(None, map(shutil.which, ("firefox-esr", "firefox"))), None)


class Firefox:
    """One browser with a profile of its own and one tab. Ends with the block.

    Without a screen it draws nothing in space; where there is Xvfb it gets one of its own and does.
    """

    def __init__(self, program: str, folder: Path) -> None:
        self._program, self._folder = program, folder
        self._ending = ExitStack()

    def __enter__(self) -> Firefox:
        with ExitStack() as started:
            self._start(started)
            self._ending = started.pop_all()
        return self

    def _start(self, started: ExitStack) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        lines = (f"user_pref({json.dumps(name)}, {json.dumps(value)});\n" for name, value in _PREFERENCES.items())
        (self._folder / "user.js").write_text("".join(lines))
        xvfb = shutil.which("Xvfb")
        environment = {**os.environ, "MOZ_ENABLE_WAYLAND": "0"}
        if xvfb is not None:
            environment["DISPLAY"] = started.enter_context(_screen(xvfb))
        command = [
            self._program, *([] if xvfb else ["--headless"]), "--no-remote", "--profile", str(self._folder),
            "--remote-debugging-port=0", "about:blank",
        ]  # fmt: skip
        process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        started.callback(_end, process)
        deadline_s, port, file = time.monotonic() + _START_S, None, self._folder / "WebDriverBiDiServer.json"
        while port is None:
            assert time.monotonic() < deadline_s, "the browser did not start"
            assert process.poll() is None, "the browser ended"
            time.sleep(0.05)
            with suppress(OSError, ValueError):
                port = json.loads(file.read_text())["ws_port"]
        self._address = f"ws://127.0.0.1:{port}/session"

    def open(self, address: str) -> FirefoxTab:
        tab = FirefoxTab(self._ending.enter_context(connect(self._address, max_size=None)))
        tab.go(address)
        return tab

    def __exit__(self, *_: object) -> None:
        self._ending.close()


@contextmanager
def _screen(program: str) -> Iterator[str]:
    """The name of a screen in memory."""
    process = subprocess.Popen(
        [program, "-displayfd", "1", "-screen", "0", "1400x1000x24", "-nolisten", "tcp"],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    try:
        yield ":" + process.stdout.readline().strip()
    finally:
        _end(process)


def _end(process: subprocess.Popen[Any]) -> None:
    process.terminate()
    process.wait(20)
    if process.stdout is not None:
        process.stdout.close()


class FirefoxTab(Tab):
    """One page of Firefox."""

    def __init__(self, socket: ClientConnection) -> None:
        super().__init__(socket, _ANSWER_S)
        wanted = {"alwaysMatch": {"unhandledPromptBehavior": {"default": "ignore"}}}
        self.call("session.new", capabilities=wanted)
        self.call("session.subscribe", events=["log.entryAdded"])
        self._context = self.call("browsingContext.getTree")["contexts"][0]["context"]
        self.screen(1280, 900)

    def _check(self, method: str, answer: dict[str, Any]) -> None:
        if answer["type"] == "error":
            gone = answer["error"] in ("no such frame", "no such realm", "unknown error")
            raise (Left if gone else AssertionError)(f"{method}: {answer['error']}: {answer['message']}")

    def _note(self, event: dict[str, Any]) -> None:
        if event.get("method") != "log.entryAdded" or event["params"]["level"] not in ("error", "warn"):
            return
        text = event["params"]["text"]
        if "WebGL" not in (text or ""):  # how it draws without a graphics card
            self.console.append(text)

    def before_each_page(self, script: str) -> None:
        self.call("script.addPreloadScript", functionDeclaration=f"() => {{ {script} }}")

    def go(self, address: str) -> None:
        self.call("browsingContext.navigate", context=self._context, url=address, wait="none")

    def reload(self) -> None:
        self.call("browsingContext.reload", context=self._context, wait="none")

    def run(self, expression: str) -> Any:
        # what the protocol returns is a tree of its own: a text of JSON is not
        told = f"(async () => JSON.stringify(await ({expression})))()"
        answer = self.call(
            "script.evaluate",
            expression=told,
            target={"context": self._context},
            awaitPromise=True,
            userActivation=True,
        )
        assert answer["type"] == "success", answer["exceptionDetails"]["text"]
        return json.loads(answer["result"]["value"]) if answer["result"]["type"] == "string" else None

    def _act(self, kind: str, actions: list[dict[str, Any]], **more: Any) -> None:
        source = {"type": kind, "id": kind, "actions": actions, **more}
        self.call("input.performActions", context=self._context, actions=[source])

    def key(self, key: str) -> None:
        value = _KEYS.get(key, key)
        self._act("key", [{"type": kind, "value": value} for kind in ("keyDown", "keyUp")])

    def write(self, text: str) -> None:
        for letter in text:
            self.key(letter)

    def press_at(self, x: float, y: float, held_s: float = 0.0) -> None:
        move = {"type": "pointerMove", "x": round(x), "y": round(y)}
        held = {"type": "pause", "duration": round(1e3 * held_s)}
        self._act("pointer", [move, {"type": "pointerDown", "button": 0}, held, {"type": "pointerUp", "button": 0}])

    def choose_file(self, path: Path) -> None:
        chooser = "document.querySelector('input[type=file]')"
        found = self.call("script.evaluate", expression=chooser, target={"context": self._context}, awaitPromise=False)[
            "result"
        ]
        element = {"sharedId": found["sharedId"]}
        self.call("input.setFiles", context=self._context, element=element, files=[str(path)])

    def screen(self, width: int, height: int) -> None:
        self.call("browsingContext.setViewport", context=self._context, viewport={"width": width, "height": height})

    def picture(self, path: Path) -> None:
        data = self.call("browsingContext.captureScreenshot", context=self._context)["data"]
        path.write_bytes(base64.b64decode(data))
