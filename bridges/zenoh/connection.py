"""A connection that comes when it comes: work goes on while nobody listens yet."""

from __future__ import annotations

import threading

import zenoh

from bridges.zenoh.session import open_client


class Connection:
    """Opens a client session in the background, in the name of an identity or of TWIN_AS. `session` is None until the
    other side is there."""

    def __init__(self, endpoint: str, name: str | None = None) -> None:
        self.session: zenoh.Session | None = None
        self._stop = threading.Event()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._open, args=(endpoint, name), name="twin-connect", daemon=True)
        self._thread.start()

    def _open(self, endpoint: str, name: str | None) -> None:
        self.session = open_client(endpoint, None, self._stop, name)
        self._ready.set()

    def wait(self, timeout_s: float) -> bool:
        """Whether the session is there, at the latest after `timeout_s`."""
        return self._ready.wait(timeout_s) and self.session is not None

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        if self.session is not None:
            self.session.close()

    def __enter__(self) -> Connection:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
