"""The other end of sd_notify, for processes that tests start."""

from __future__ import annotations

import socket
import uuid


class Manager:
    """A socket in no folder, named as NOTIFY_SOCKET would be."""

    def __init__(self) -> None:
        self.name = f"@twin-test-{uuid.uuid4()}"
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind("\0" + self.name[1:])
        self.socket.settimeout(20.0)

    def hear(self, wanted: str) -> list[str]:
        """What is said until `wanted`, the latter included."""
        said: list[str] = []
        while not said or not said[-1].startswith(wanted):
            said.append(self.socket.recv(4096).decode())
        return said

    def waiting(self) -> list[str]:
        """What has been said and was not heard yet."""
        said = []
        self.socket.setblocking(False)
        try:
            while True:
                said.append(self.socket.recv(4096).decode())
        except BlockingIOError:
            self.socket.settimeout(20.0)
        return said
