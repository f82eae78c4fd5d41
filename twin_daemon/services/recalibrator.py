"""Recalibration by the daemon: when it is due, in a process of the lowest priority, one at a time."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from twin_daemon.daemon import reports
from twin_daemon.daemon.automatic import AutomaticRun
from twin_daemon.daemon.consent import CONSENT, NoConsent, standing
from twin_daemon.daemon.probation import Live, Probation
from twin_daemon.daemon.schedule import Schedule, Unfinished
from twin_daemon.daemon.service import TwinService
from twin_daemon.errors import TwinError
from twin_daemon.recalibration.settings import RecalibrationSettings
from twin_daemon.security.identity import Keyring
from twin_daemon.services.child import Child
from twin_daemon.services.guard import Guard
from twin_daemon.services.ring_saver import RingSaver
from twin_daemon.versions import VersionStore, promised_rad2

log = logging.getLogger("twin")

_MOVES_RAD_S = 0.05
_RESTS_RAD = 0.05
_IDLE_S = 10.0
_PERIOD_S = 1.0
_AUTOMATIC_S = 0.2  # while a motion of its own comes or goes on
_AFTER_CANCEL_MIN = 60.0  # whoever has cancelled one is not to find the next one at once
_MOST_SAID = 4  # changes in one sentence
_KEEP_S = 60.0  # so much motion is forgotten where the daemon is killed
_HANGS_S = 6 * 3600.0  # at the lowest priority beside other work a run is slow; after this long it hangs


class Announces(Protocol):
    """What tells everybody of motion that begins by itself."""

    def tell(self, told: dict[str, Any] | None) -> None: ...


class Recalibrator:
    """Works in a thread of its own, so that the loop never waits for a disk. `arguments` name hand and network for the
    command line.
    """

    def __init__(
        self,
        settings: RecalibrationSettings,
        saver: RingSaver,
        service: TwinService,
        store: VersionStore,
        folder: Path,
        arguments: Sequence[str],
    ) -> None:
        self._settings = settings
        self._saver, self._service, self._store = saver, service, store
        self._folder = folder
        self._arguments = list(arguments)
        self.schedule = Schedule(settings, folder / "recalibration.json", datetime.now(UTC))
        self._probation = Probation(settings.probation_s, settings.worse)
        self._child: Child | None = None
        self._automatic: AutomaticRun | None = None  # of an active run, until its motion is over
        self._cancelled: str | None = None
        self._announcer: Announces | None = None
        self._keyring = Keyring({})
        self._began_s = self._looked_s = self._kept_s = self._moved_s = time.monotonic()
        self._rests_at = np.full(len(service.joints), np.nan)
        self._said = self._announced_ns = 0
        self._last: dict[str, Any] | None = None
        self._lock = threading.RLock()
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
            "consent": self._consent(now)[1] if self._settings.mode == "active" else None,
            "automatic": None if self._automatic is None else self._automatic.told(time.monotonic()),
            "running": self._child is not None,
            "last": self._last,
        }

    def ask(self, who: str) -> str | None:
        """Begins one because somebody who may command asks for it; why not, if not."""
        return self._begin(f"asked for by {who}", drive=self._settings.mode == "active")

    def announces(self, announcer: Announces, keyring: Keyring) -> None:
        """Tells from now on through `announcer` what moves by itself, in the name of an identity of this keyring.
        Nothing does without them."""
        self._announcer, self._keyring = announcer, keyring

    def cancel(self, why: str) -> bool:
        """Ends a motion that is announced or under way; whether there was one. Anybody may."""
        with self._lock:
            if self._automatic is None:
                return False
            self._cancelled = "cancelled" + (f": {why}" if why else "")
            if self._automatic.phase == "announced":
                self._give_up(self._cancelled)
            return True  # what is under way its own thread ends

    # -- its thread ----------------------------------------------------------------------------------------

    def _work(self) -> None:
        while not self._stop.wait(_PERIOD_S if self._automatic is None else _AUTOMATIC_S):
            self._guard.run("the recalibration", self._poll)
            if self._announcer is not None:
                run = self._automatic
                self._guard.run("an announcement", self._announcer.tell, run and run.told(time.monotonic()))

    def _poll(self) -> None:
        """Counts motion, notices drift, begins what is due, takes up what has ended, watches a new version."""
        now_s, now = time.monotonic(), datetime.now(UTC)
        moving = bool((np.abs(self._service.mirror.velocity) > _MOVES_RAD_S).any()) and not self._service.stale
        if moving:
            self.schedule.moved(min(now_s - self._looked_s, 2.0 * _PERIOD_S))
        self._look_for_rest(now_s)
        self._looked_s = now_s
        if now_s - self._kept_s > _KEEP_S:
            self.schedule.save()
            self._kept_s = now_s
        for event in self._service.recent_events()["events"][-20:]:
            if event["kind"] == "drift" and event["stamp_ns"] > self._said:
                self._said = event["stamp_ns"]
                self.schedule.drifted(event["joint"], event["since_ns"])
        self._watch_version(now_s)
        self._tend_automatic(now_s, now)
        if self._child is not None:
            self._take_up(now_s)
            return
        if self._automatic is not None:
            return
        if self.schedule.unfinished is not None:
            self._resume(self.schedule.unfinished)
            return
        why = self.schedule.due(now)
        if why is None:
            return
        drive = self._settings.mode == "active"
        if drive and self._in_the_way() is not None:
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
        self.schedule.save()
        child, self._child = self._child, None
        if child is not None:
            child.end()

    # -- motion of its own ---------------------------------------------------------------------------------

    def _look_for_rest(self, now_s: float) -> None:
        """Rest is told by positions: one velocity out of noise is no motion, and slow motion is one."""
        position = self._service.mirror.position
        if not (np.isfinite(position) & ~(np.abs(position - self._rests_at) <= _RESTS_RAD)).any():
            return
        self._rests_at, self._moved_s = position.copy(), now_s

    def _in_the_way(self) -> str | None:
        """Why the hand is not to be moved now, whoever asks; None where it is free and at rest."""
        gate = self._service.gate()
        if gate is None:
            return "no gate of this hand is heard"
        if gate["mode"] != "read_only":
            return f"the gate is not free: {gate['mode'].replace('_', ' ')} by {gate['commander'] or gate['ended']}"
        if self._service.stale:
            return "the hand is silent"
        if time.monotonic() - self._moved_s < _IDLE_S:
            return f"the hand has not been at rest for {_IDLE_S:.0f} s"
        return None

    def _consent(self, now: datetime) -> tuple[bool, str]:
        """Whether somebody has consented, and who, or why not."""
        try:
            return True, standing(self._folder / CONSENT, now).in_words()
        except NoConsent as error:
            return False, str(error)

    def _announce(self, why: str, now: datetime) -> str | None:
        """Begins to count down; why not, if not. Under the lock."""
        if self._announcer is None:
            return "nobody can be told that the hand is going to move"
        if self._settings.identity not in self._keyring:
            todo = f"twin security add {self._settings.identity} --role operator"
            return f"the key file has no identity '{self._settings.identity}' to arm in the name of: '{todo}'"
        given, words = self._consent(now)
        against = self._in_the_way() if given else words
        if against is not None:
            return against
        settings = self._settings
        run = Unfinished(why, list(self.schedule.drifting), None)
        now_s = time.monotonic()
        self._announced_ns, self._cancelled = self._service.wall_ns(), None
        self._automatic = AutomaticRun(run, settings.trajectory, settings.identity, now_s, settings.countdown_s)
        told = self._automatic.told(now_s)
        self._service.tell("automatic", f"{told['words']}. {words}", {key: told[key] for key in ("phase", "why")})
        return None

    def _tend_automatic(self, now_s: float, now: datetime) -> None:
        """Counts down, starts, and ends what is cancelled, stopped or no longer consented to."""
        with self._lock:
            run = self._automatic
            if run is None:
                return
            given, words = self._consent(now)
            against = self._cancelled or self._stopped() or (None if given else words)
            if run.phase == "announced":
                against = against or self._in_the_way() or ("quiet hours" if self.schedule.is_quiet(now) else None)
                if against is not None:
                    self._give_up(against)
                elif run.is_due(now_s):
                    run.started()
                    self._start(run.run)
                return
            over = run.look((self._service.gate() or {}).get("commander"))
            if over or self._child is None or not self._child.running:
                self._automatic = None
            elif against is not None:
                self._child.end()  # it disarms, and the hand comes to rest
                self._give_up(against)

    def _stopped(self) -> str | None:
        """Whether somebody has stopped the hand since the run was announced, also if it was released again."""
        events = self._service.recent_events()["events"]
        stops = (e for e in events if e["kind"] == "gate" and e.get("verb") == "stop" and e.get("accepted"))
        return next((e["text"] for e in stops if e["stamp_ns"] >= self._announced_ns), None)

    def _give_up(self, why: str) -> None:
        """The announced or moving run is over. Under the lock."""
        self._automatic = None
        self.schedule.postponed(datetime.now(UTC), _AFTER_CANCEL_MIN)
        self._service.tell("automatic", f"the hand does not move by itself: {why}", {"phase": "none", "why": why})

    # -- runs ----------------------------------------------------------------------------------------------

    def _begin(self, why: str, drive: bool) -> str | None:
        with self._lock:
            if self._child is not None:
                return "one is running"
            if self._automatic is not None:
                return "one is announced"
            now = datetime.now(UTC)
            if self.schedule.is_quiet(now):
                return f"no run begins in the quiet hours {self._settings.quiet} UTC"
            if drive:
                return self._announce(why, now)
            # what the hand did before it drifted is another hand's motion
            kept = self._saver.save(self.schedule.drifting_since_ns)
            if not kept["kept"]:
                return str(kept["why"])
            self._start(Unfinished(why, list(self.schedule.drifting), str(kept["path"])))
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
            key: found[key]
            for key in ("version", "better", "candidate", "promoted", "against", "appeared", "changed", "gain")
        }
        changed = f"; {', '.join(found['changed'][:_MOST_SAID])}" if found["changed"] else ""
        appeared = f"; {', '.join(found['appeared'])} has appeared" if found["appeared"] else ""
        what = (
            "promoted" if found["promoted"] else "kept as a candidate" if found["candidate"] else "stored, no candidate"
        )
        against = f" ({'; '.join(found['against'])})" if found["against"] else ""
        gain = f"{found['gain']:.0%} of the held-out error gone"
        text = f"recalibrated: {gain}{appeared}{changed}; {found['version'][:12]} is {what}{against}"
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
