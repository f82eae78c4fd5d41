"""Sends a signal to a unit's process and says after how many seconds another process does its work again.

Runs inside the booted system, with the Python of the installation: `python boot_probe.py UNIT SIGNAL [VERSION]`. The
daemon has to serve VERSION and to follow its hand, the workbench to answer with its page, the bridge to be ready. With
SIGNAL 0 it only waits for that. Exit code 1 where it takes longer than a minute.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import urllib.request

from bridges.zenoh.client import ask_once
from bridges.zenoh.session import choose_endpoint
from twin_daemon.errors import TwinError

PATIENCE_S = 60.0


def ready_pid(unit: str) -> int:
    """The unit's process once it is ready, else 0: questions before that would only take its time."""
    command = ["systemctl", "show", "--property=MainPID,ActiveState", unit]
    said = subprocess.run(command, capture_output=True, text=True).stdout
    found = dict(line.split("=", 1) for line in said.splitlines())
    return int(found["MainPID"]) if found.get("ActiveState") == "active" else 0


def followed_version() -> str | None:
    """The version by which the daemon follows its hand; None while it does not."""
    try:
        state = ask_once(choose_endpoint(), "twin/shadow_hand/state", 0.5)
        version = ask_once(choose_endpoint(), "twin/shadow_hand/version", 0.5)["id"]
    except TwinError:
        return None
    return version if state["status"] == "following" else None


def page() -> str | None:
    """What the workbench shows; None while it does not."""
    try:
        with urllib.request.urlopen("http://127.0.0.1:8460/", timeout=2.0) as answer:
            return "its page" if b"</html>" in answer.read() else None
    except OSError:
        return None


WORK = {"twin-daemon": followed_version, "twin-workbench": page, "twin-bridge-ros2": lambda: "ready"}


def main() -> int:
    unit, number, version = sys.argv[1], int(sys.argv[2]), (sys.argv[3:] or [None])[0]
    began_s, before = time.monotonic(), 0
    if number:
        before = ready_pid(unit)
        os.kill(before, signal.Signals(number))
    while time.monotonic() - began_s < PATIENCE_S:
        pid = ready_pid(unit)
        if pid and pid != before:
            found = WORK[unit]()
            if found is not None and version in (None, found):
                print(f"{time.monotonic() - began_s:.1f} {found}")
                return 0
        time.sleep(0.1)
    return 1


if __name__ == "__main__":
    raise SystemExit(main())
