"""Telling systemd that the service is ready and alive; without systemd nothing happens."""

from __future__ import annotations

import os
import socket
import time


class Notifier:
    """Speaks sd_notify: one datagram for each state. A socket that is not there or full is no error."""

    def __init__(self) -> None:
        self._address = os.environ.get("NOTIFY_SOCKET", "")
        watchdog_us = os.environ.get("WATCHDOG_USEC", "")
        self._period_s = int(watchdog_us) / 4e6 if watchdog_us.isdigit() else None
        self._next_s = 0.0

    def say(self, state: str) -> None:
        """Sends a state such as READY=1 or STOPPING=1."""
        if not self._address:
            return
        address = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sender:
                sender.setblocking(False)
                sender.sendto(state.encode(), address)
        except OSError:
            return

    def reloading(self) -> None:
        """Says that the configuration is being read again; READY=1 says that it has been."""
        self.say(f"RELOADING=1\nMONOTONIC_USEC={time.monotonic_ns() // 1000}")

    def alive(self) -> None:
        """Feeds the watchdog, four times in its period, from the loop that must not hang."""
        if self._period_s is not None and time.monotonic() >= self._next_s:
            self._next_s = time.monotonic() + self._period_s
            self.say("WATCHDOG=1")
