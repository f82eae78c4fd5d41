"""Long work for the page, each in a process of its own: `twin check`, `diagnose`, `propose`, `add` and `ladder`, one
at a time."""

from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from twin_daemon.errors import BadInput, Refused
from twin_daemon.resources import step_back, twin_command

Kind = Literal["check", "diagnose", "propose", "add", "ladder"]
Status = Literal["running", "done", "failed", "stopped"]

_NICE = 10  # below what is live, but somebody waits for it
_PATIENCE_S = 5.0
_INTERRUPTED = 130
_MOST_LINES = 5000
_WIDE = {"COLUMNS": "300", "TERM": "dumb", "NO_COLOR": "1"}  # lines as they are, neither wrapped nor coloured


@dataclass
class Job:
    """One process. `lines` are what it said so far, `result` what it wrote in the end, to `path`;
    `limit_s` is after how long it ends by itself, where somebody said so."""

    number: int
    kind: Kind
    about: dict[str, str]
    process: subprocess.Popen[str]
    path: Path
    began_s: float
    lines: list[str] = field(default_factory=list)
    status: Status = "running"
    result: dict[str, Any] | None = None
    error: str | None = None
    stopping: bool = False
    ended_s: float | None = None
    limit_s: float | None = None


class Jobs:
    """The running job, and the last of each kind; every browser sees the same. Safe from several threads."""

    def __init__(self, hand_options: Sequence[str]) -> None:
        self._hand = list(hand_options)
        self._numbers = itertools.count(1)
        self._lock = threading.Lock()
        self._latest: dict[Kind, Job] = {}
        self._running: Job | None = None
        self._thread: threading.Thread | None = None
        self._folder = tempfile.TemporaryDirectory(prefix="twin-workbench-")

    def start(self, kind: Kind, arguments: Sequence[str], about: dict[str, str], limit_s: float | None = None) -> Job:
        """Begins `twin KIND ARGUMENTS`. Raises Refused while another one runs."""
        with self._lock:
            if self._running is not None:
                raise Refused(f"a {self._running.kind} is running", todo="Stop it, or wait until it has ended")
            number = next(self._numbers)
            target = Path(self._folder.name) / f"{number}.json"
            process = subprocess.Popen(
                twin_command(kind, *arguments, *self._hand, "--json", str(target)),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
                errors="replace",
                env={**os.environ, **_WIDE},
                start_new_session=True,  # a Ctrl-C for the server ends it in order, by `close`
            )
            step_back(process.pid, _NICE)
            job = Job(number, kind, about, process, target, time.time(), limit_s=limit_s)
            self._latest[kind] = self._running = job
            self._thread = threading.Thread(target=self._follow, args=(job, target), name="twin-job", daemon=True)
            self._thread.start()
        return job

    def latest(self, kind: Kind) -> Job | None:
        """The running or the last job of a kind."""
        with self._lock:
            return self._latest.get(kind)

    def stop(self) -> None:
        """Asks the running job to end and to keep what is done. Raises BadInput where none runs."""
        with self._lock:
            job = self._running
            if job is None:
                raise BadInput("nothing runs")
            job.stopping = True
            job.process.send_signal(signal.SIGINT)

    def close(self) -> None:
        """Ends what runs."""
        with self._lock:
            job, thread = self._running, self._thread
        if job is not None:
            job.stopping = True
            job.process.terminate()
            try:
                job.process.wait(_PATIENCE_S)
            except subprocess.TimeoutExpired:
                job.process.kill()
        if thread is not None:
            thread.join()
        self._folder.cleanup()

    def _follow(self, job: Job, target: Path) -> None:
        assert job.process.stderr is not None
        with job.process.stderr as said:
            for line in said:
                if (text := line.strip()) and len(job.lines) < _MOST_LINES:
                    job.lines.append(text)
        code = job.process.wait()
        result, error = _read(target, code, job.lines)
        with self._lock:
            job.result, job.error, job.ended_s = result, error, time.time()
            ended = job.stopping and code in (_INTERRUPTED, -signal.SIGTERM, -signal.SIGINT)
            job.status = "done" if result is not None else "stopped" if ended else "failed"
            self._running = None


def _read(target: Path, code: int, lines: Sequence[str]) -> tuple[dict[str, Any] | None, str | None]:
    """(the result, None), or (None, why there is none)."""
    if code == 0:
        try:
            return json.loads(target.read_text(encoding="utf-8")), None
        except (OSError, ValueError) as error:
            return None, str(error)
    return None, lines[-1] if lines else f"it ended with exit code {code}"
