"""The gate as a child of `twin run`: started before the daemon is ready, started again when it dies, ended with it.

It ends, too, when the daemon dies without a word: its standard input then comes to an end.
"""

from __future__ import annotations

import json
import logging
import os
import select
import subprocess
import time
from collections.abc import Callable, Sequence
from typing import IO

from twin_daemon.errors import BadInput, NoAnswer, TwinError, UsageError
from twin_daemon.resources import twin_command
from twin_daemon.services.stop import Stoppable

log = logging.getLogger("twin")

READY = "ready"
_START_S = 60.0
_END_S = 8.0
_AGAIN_S = 0.5
_ERRORS: dict[int, type[TwinError]] = {one.exit_code: one for one in (UsageError, BadInput, NoAnswer)}


class GateProcess:
    """`twin gate ARGUMENTS` with a pipe each way. Call `tend` now and then."""

    def __init__(self, arguments: Sequence[str], tell: Callable[[str, str], None]) -> None:
        self._arguments = list(arguments)
        self._tell = tell
        self._process = self._start()
        self._died_s: float | None = None

    def _start(self) -> subprocess.Popen[bytes]:
        # systemd watches the daemon; the gate's own word would be taken for the daemon's
        environment = {key: value for key, value in os.environ.items() if key not in ("NOTIFY_SOCKET", "WATCHDOG_USEC")}
        return subprocess.Popen(
            twin_command("gate", *self._arguments, "--with-daemon"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
        )

    @property
    def pid(self) -> int:
        return self._process.pid

    def wait(self, stop: Stoppable) -> None:
        """Until the gate serves. Raises what the gate has said, where it could not begin."""
        out = self._process.stdout
        assert out is not None
        deadline_s = time.monotonic() + _START_S
        while not stop.is_set():
            if select.select([out], [], [], 0.1)[0]:
                _judge(out, self._process)
                return
            if time.monotonic() > deadline_s:
                raise NoAnswer("the gate's process does not begin", todo="Look at what it has logged")

    def tend(self) -> None:
        """Starts it again where it has died. It begins read-only, or stopped where it was."""
        if self._process.poll() is None:
            return
        now_s = time.monotonic()
        if self._died_s is None:
            self._died_s = now_s
            code = self._process.returncode
            self._tell(
                "gate", f"the gate's process has ended (exit code {code}): the hand holds, and it is started again"
            )
        elif now_s - self._died_s > _AGAIN_S:
            self._close_pipes()
            self._process, self._died_s = self._start(), None

    def close(self) -> None:
        """Asks it to end, which brings to rest what moves, and makes it end if it does not."""
        self._process.terminate()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            log.warning("the gate's process did not end by itself")
            self._process.kill()
            self._process.wait()
        self._close_pipes()

    def _close_pipes(self) -> None:
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()


def _judge(out: IO[bytes], process: subprocess.Popen[bytes]) -> None:
    line = out.readline()
    try:
        told = json.loads(line)
    except ValueError:
        raise NoAnswer(
            f"the gate's process ended before it served (exit code {process.wait()})", todo="Look at what it has logged"
        ) from None
    if told.get(READY):
        return
    kind = _ERRORS.get(told["exit_code"], TwinError)
    raise kind(told["what"], where=told["where"], allowed=told["allowed"], todo=told["todo"])
