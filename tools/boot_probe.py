"""Sends a signal to the daemon and says after how many seconds another process serves the same version and state.

Runs inside the booted system, with the Python of the installation: `python boot_probe.py SIGNAL PID VERSION`; with
SIGNAL 0 it only waits until the daemon follows its hand. Exit code 1 where that takes longer than a minute.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

from bridges.client import ask_once
from bridges.session import choose_endpoint
from twin_daemon.errors import TwinError

PATIENCE_S = 60.0


def ready_pid() -> int:
    """The daemon's process once it is ready, else 0: questions before that would only take its time."""
    command = ["systemctl", "show", "--property=MainPID,ActiveState", "twin-daemon"]
    said = subprocess.run(command, capture_output=True, text=True).stdout
    found = dict(line.split("=", 1) for line in said.splitlines())
    return int(found["MainPID"]) if found.get("ActiveState") == "active" else 0


def served() -> tuple[str, str] | None:
    """Version and state as the daemon answers them; None while it does not."""
    try:
        state = ask_once(choose_endpoint(), "twin/shadow_hand/state", 0.5)
        return ask_once(choose_endpoint(), "twin/shadow_hand/version", 0.5)["id"], state["status"]
    except TwinError:
        return None


def main() -> int:
    number, before, version = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
    began_s = time.monotonic()
    if number:
        os.kill(before, signal.Signals(number))
    while time.monotonic() - began_s < PATIENCE_S:
        pid = ready_pid()
        if pid and not (number and pid == before):
            found = served()
            if found is not None and found[1] == "following" and version in ("any", found[0]):
                print(f"{time.monotonic() - began_s:.1f} {pid} {found[0]}")
                return 0
        time.sleep(0.1)
    return 1


if __name__ == "__main__":
    raise SystemExit(main())
