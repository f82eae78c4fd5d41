"""A real headless Chromium, driven over its debugging protocol."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

from tests.web.tab import Left, Tab

_FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--remote-debugging-port=0",
    "--remote-allow-origins=*", "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1", "--window-size=1280,900",
    "--enable-unsafe-swiftshader",
)  # fmt: skip
_START_S = 30.0
_ANSWER_S = 30.0
_CODES = {"Enter": 13, "Tab": 9, "Escape": 27, "ArrowRight": 39, "ArrowLeft": 37, "ArrowDown": 40, "End": 35}


def chromium() -> str | None:
    """The browser of this machine."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


class Browser:
    """One browser with a profile of its own; `open` gives tabs. Ends with the block."""

    def __init__(self, program: str, folder: Path) -> None:
        command = [program, *_FLAGS, f"--user-data-dir={folder}", "about:blank"]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self._tabs: list[ChromiumTab] = []
        self._port_file = folder / "DevToolsActivePort"
        self._control: ClientConnection | None = None
        self._sockets = ExitStack()

    @property
    def pid(self) -> int:
        return self._process.pid

    def __enter__(self) -> Browser:
        deadline_s = time.monotonic() + _START_S
        lines: list[str] = []
        while len(lines) < 2:
            assert time.monotonic() < deadline_s, "the browser did not start"
            assert self._process.poll() is None, "the browser ended"
            lines = self._port_file.read_text().splitlines() if self._port_file.exists() else []
            time.sleep(0.05)
        self._host = f"ws://127.0.0.1:{lines[0]}"
        self._control = self._sockets.enter_context(connect(self._host + lines[1], max_size=None))
        return self

    def open(self, address: str) -> ChromiumTab:
        assert self._control is not None
        self._control.send(json.dumps({"id": 1, "method": "Target.createTarget", "params": {"url": "about:blank"}}))
        while (answer := json.loads(self._control.recv(timeout=_START_S))).get("id") != 1:
            pass
        page = f"{self._host}/devtools/page/{answer['result']['targetId']}"
        tab = ChromiumTab(self._sockets.enter_context(connect(page, max_size=None)))
        self._tabs.append(tab)
        tab.go(address)
        return tab

    def __exit__(self, *_: object) -> None:
        for tab in self._tabs:
            tab.close()
        self._sockets.close()
        self._process.terminate()
        self._process.wait(10)


class ChromiumTab(Tab):
    """One page of Chromium."""

    def __init__(self, socket: ClientConnection) -> None:
        super().__init__(socket, _ANSWER_S)
        self._chooser: int | None = None
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setFocusEmulationEnabled", enabled=True)  # keys reach a tab behind another one

    def _check(self, method: str, answer: dict[str, Any]) -> None:
        if "navigated" in answer.get("error", {}).get("message", ""):
            raise Left(answer["error"]["message"])
        assert "error" not in answer, f"{method}: {answer['error']}"

    def _note(self, event: dict[str, Any]) -> None:
        told = event.get("params", {})
        if event.get("method") == "Runtime.exceptionThrown":
            details = told["exceptionDetails"]
            self.console.append(details.get("exception", {}).get("description") or details["text"])
        elif event.get("method") == "Runtime.consoleAPICalled" and told["type"] in ("error", "warning", "assert"):
            self.console.append(" ".join(str(part.get("value", part.get("description"))) for part in told["args"]))
        elif event.get("method") == "Log.entryAdded" and told["entry"]["level"] in ("error", "warning"):
            if "GL Driver Message" in told["entry"]["text"]:
                return  # how fast it draws without a graphics card
            self.console.append(f"{told['entry']['text']} {told['entry'].get('url', '')}")
        elif event.get("method") == "Page.fileChooserOpened":
            self._chooser = told["backendNodeId"]

    def before_each_page(self, script: str) -> None:
        self.call("Page.addScriptToEvaluateOnNewDocument", source=script)

    def go(self, address: str) -> None:
        self.call("Page.navigate", url=address)

    def reload(self) -> None:
        self.call("Page.reload")

    def run(self, expression: str) -> Any:
        answer = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def key(self, key: str) -> None:
        code = {"windowsVirtualKeyCode": _CODES[key], "code": key} if key in _CODES else {}
        for kind in ("keyDown", "keyUp"):
            text = "\r" if key == "Enter" else key if len(key) == 1 else ""
            typed = {"text": text} if kind == "keyDown" and text else {}
            self.call("Input.dispatchKeyEvent", type=kind, key=key, **typed, **code)

    def write(self, text: str) -> None:
        self.call("Input.insertText", text=text)

    def press_at(self, x: float, y: float, held_s: float = 0.0) -> None:
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            time.sleep(held_s if kind == "mouseReleased" else 0.0)
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def keep_choosers_closed(self) -> None:
        """From now on a chooser of files waits for `choose_file` instead of showing its dialog."""
        self.call("Page.setInterceptFileChooserDialog", enabled=True)

    def choose_file(self, path: Path) -> None:
        for _ in range(100):
            if self._chooser is not None:
                break
            self.run("0")  # reads what has happened
            time.sleep(0.05)
        assert self._chooser is not None, "the page opened no chooser of files"
        self.call("DOM.enable")
        self.call("DOM.setFileInputFiles", files=[str(path)], backendNodeId=self._chooser)
        self._chooser = None

    def drop(self, path: Path, x: float = 600.0, y: float = 400.0) -> None:
        """Drags a file of the disk over the page and lets it fall."""
        data = {"items": [], "files": [str(path)], "dragOperationsMask": 1}
        for kind in ("dragEnter", "dragOver", "drop"):
            self.call("Input.dispatchDragEvent", type=kind, x=x, y=y, data=data)

    def screen(self, width: int, height: int) -> None:
        phone = width < 600
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1 + phone, mobile=phone
        )

    def colours(self, scheme: str) -> None:
        """What the system prefers: 'light' or 'dark'."""
        self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])

    def picture(self, path: Path) -> None:
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))
