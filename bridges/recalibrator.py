"""Recalibration by the daemon: when it is due, in a process of the lowest priority, one at a time."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from bridges.child import Child
from bridges.guard import Guard
from bridges.keep import Keeper
from twin_daemon.daemon import reports
from twin_daemon.daemon.probation import Live, Probation
from twin_daemon.daemon.schedule import Schedule, Unfinished
from twin_daemon.daemon.service import TwinService
from twin_daemon.errors import TwinError
from twin_daemon.recalibration.settings import RecalibrationSettings
from twin_daemon.versions import VersionStore, promised_rad2

log = logging.getLogger("twin")

_MOVES_RAD_S = 0.05
_IDLE_S = 10.0
_PERIOD_S = 1.0
_KEEP_S = 60.0  # so much motion is forgotten where the daemon is killed
_HANGS_S = 6 * 3600.0  # at the lowest priority beside other work a run is slow; after this long it hangs


class Recalibrator:
    """Works in a thread of its own, so that the loop never waits for a disk. `arguments` name hand and network for the
    command line.
    """

    def __init__(
        self,
        settings: RecalibrationSettings,
        keeper: Keeper,
        service: TwinService,
        store: VersionStore,
        folder: Path,
        arguments: Sequence[str],
    ) -> None:
        self._settings = settings
        self._keeper, self._service, self._store = keeper, service, store
        self._folder = folder
        self._arguments = list(arguments)
        self.schedule = Schedule(settings, folder / "recalibration.json", datetime.now(UTC))
        self._probation = Probation(settings.probation_s, settings.worse)
        self._child: Child | None = None
        self._began_s = self._looked_s = self._kept_s = self._moved_s = time.monotonic()
        self._said = 0
        self._last: dict[str, Any] | None = None
        self._lock = threading.Lock()
        self._guard = Guard(log)
        self._stop = threading.Event()
        service.tell("schedule", self.schedule.in_words(datetime.now(UTC)))
        self._thread = threading.Thread(target=self._work, name="twin-recalibration", daemon=True)
        self._thread.start()

    # -- questions -----------------------------------------------------------------------------------------

    def status(self, _key: str = "") -> dict[str, Any]:
        """When the next one is, whether one runs, and what the last one found."""
        now = datetime.now(UTC)
        at = self.schedule.next(now)
        return reports.header(self._service) | {
            "mode": self._settings.mode,
            "policy": self._settings.policy,
            "words": self.schedule.in_words(now),
            "next": None if at is None else at.isoformat(),
            "motion_hours": self.schedule.motion_s / 3600.0,
            "drifting": list(self.schedule.drifting),
            "running": self._child is not None,
            "last": self._last,
        }

    def ask(self, who: str) -> str | None:
        """Begins one because somebody who may command asks for it; why not, if not."""
        return self._begin(f"asked for by {who}", drive=self._settings.mode == "active")

    # -- its thread ----------------------------------------------------------------------------------------

    def _work(self) -> None:
        while not self._stop.wait(_PERIOD_S):
            self._guard.run("the recalibration", self._poll)

    def _poll(self) -> None:
        """Counts motion, notices drift, begins what is due, takes up what has ended, watches a new version."""
        now_s, now = time.monotonic(), datetime.now(UTC)
        moving = bool((np.abs(self._service.mirror.velocity) > _MOVES_RAD_S).any()) and not self._service.stale
        if moving:
            self.schedule.moved(min(now_s - self._looked_s, 2.0 * _PERIOD_S))
            self._moved_s = now_s
        self._looked_s = now_s
        if now_s - self._kept_s > _KEEP_S:
            self.schedule.keep()
            self._kept_s = now_s
        for event in self._service.recent_events()["events"][-20:]:
            if event["kind"] == "drift" and event["stamp_ns"] > self._said:
                self._said = event["stamp_ns"]
                self.schedule.drifted(event["joint"], event["since_ns"])
        self._watch_version(now_s)
        if self._child is not None:
            self._take_up(now_s)
            return
        if self.schedule.unfinished is not None:
            self._resume(self.schedule.unfinished)
            return
        why = self.schedule.due(now)
        if why is None:
            return
        drive = self._settings.mode == "active"
        if drive and (now_s - self._moved_s < _IDLE_S or not self._gate_is_free()):
            return  # later: somebody works with the hand
        refused = self._begin(why, drive)
        if refused is not None:
            self.schedule.postponed(now)
            self._service.tell("recalibration", f"no recalibration ({why}): {refused}")

    def taken_up(self, version: dict[str, Any], before: Live) -> None:
        """The loop goes on with another version."""
        promised = promised_rad2(version.get("errors"))
        self._probation.begin(str(version["id"]), promised, before, time.monotonic())

    def close(self) -> None:
        """Ends a run; the schedule is kept."""
        self._stop.set()
        self._thread.join()
        self.schedule.keep()
        child, self._child = self._child, None
        if child is not None:
            child.end()

    def _gate_is_free(self) -> bool:
        gate = self._service.gate()
        return gate is not None and gate["mode"] == "read_only"

    def _begin(self, why: str, drive: bool) -> str | None:
        with self._lock:
            if self._child is not None:
                return "one is running"
            recording = None
            if not drive:
                # what the hand did before it drifted is another hand's motion
                kept = self._keeper.keep(self.schedule.drifting_since_ns)
                if not kept["kept"]:
                    return str(kept["why"])
                recording = str(kept["path"])
            self._start(Unfinished(why, list(self.schedule.drifting), recording))
        return None

    def _resume(self, run: Unfinished) -> None:
        """Goes on, once, with what a restart has cut short: from its recording, not by driving the hand once more."""
        if run.again or run.recording is None or not Path(run.recording).exists() or self._settings.mode == "off":
            self._service.tell("recalibration", f"a recalibration ({run.why}) was cut short by a restart")
            self.schedule.ended()
            return
        with self._lock:
            if self._child is None:  # else somebody has asked for one meanwhile
                self._start(replace(run, why=f"{run.why}; begun again after a restart", again=True))

    def _start(self, run: Unfinished) -> None:
        """Starts the process; under the lock."""
        drives = ["--run", self._settings.trajectory, "--as", self._settings.identity]
        source = drives if run.recording is None else ["--recording", run.recording]
        arguments = [
            "recalibrate", *source, *self._arguments, "--version", str(self._service.version_info["id"]),
            "--within", str(self._settings.seconds), *(["--joints", *run.joints] if run.joints else []),
            *(["--promote"] if self._settings.policy == "automatic" else []),
        ]  # fmt: skip
        result = self._folder / "recalibration.result.json"
        self._child = Child(*arguments, result=result, nice=self._settings.nice)
        self._began_s = time.monotonic()
        self.schedule.begun(datetime.now(UTC), run)
        told = {"why": run.why, "joints": run.joints}
        self._service.tell("recalibration", f"a recalibration has begun: {run.why}", told)

    def _take_up(self, now_s: float) -> None:
        child = self._child
        if child is None:
            return
        if child.running:
            if now_s - self._began_s > self._settings.seconds + _HANGS_S:
                child.end()
            return
        found = child.outcome()
        self.schedule.ended()
        self._child = None
        if "error" in found:
            self._last = found
            self._service.tell("recalibration", f"the recalibration failed: {found['error']}")
            return
        self._last = {
            key: found[key] for key in ("version", "better", "candidate", "promoted", "against", "appeared", "gain")
        }
        appeared = f"; {', '.join(found['appeared'])} has appeared" if found["appeared"] else ""
        what = (
            "promoted" if found["promoted"] else "kept as a candidate" if found["candidate"] else "stored, no candidate"
        )
        against = f" ({'; '.join(found['against'])})" if found["against"] else ""
        gain = f"{found['gain']:.0%} of the held-out error gone"
        text = f"recalibrated: {gain}{appeared}; {found['version'][:12]} is {what}{against}"
        self._service.tell("recalibration", text, self._last)

    def _watch_version(self, now_s: float) -> None:
        failed = self._probation.failed(live(self._service), now_s)
        if failed is None:
            return
        version, found_rad2, bound_rad2 = failed
        words = f"{version[:12]} shows {found_rad2:.3g} rad² live, more than {bound_rad2:.3g}"
        try:
            back = self._store.rollback(expected=version)
        except TwinError as error:
            self._service.tell("rollback", f"{words}, and cannot be rolled back: {error.line()}")
            return
        self._store.note(version, f"rolled back by itself: {words}")
        self._service.tell("rollback", f"{words}: rolled back to {back.short_id}", {"from": version, "to": back.id})


def live(service: TwinService) -> Live:
    """What the version in use shows now."""
    statistics = service.residuals.statistics()
    seen = statistics.samples > 0
    if not seen.any():
        return Live(0.0, 0)
    return Live(float(statistics.mse_rad2[seen].mean()), int(statistics.samples.max()))
