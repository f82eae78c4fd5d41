"""What has changed since the version in use, said by the daemon itself once a joint drifts."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from twin_daemon.daemon.service import TwinService
from twin_daemon.errors import TwinError
from twin_daemon.services.child import Child
from twin_daemon.services.guard import Guard
from twin_daemon.services.ring_saver import RingSaver
from twin_daemon.versions import VersionStore

log = logging.getLogger("twin")

_PERIOD_S = 1.0
_WATCHED_S = 30.0  # of motion since the alarm, so that what is diagnosed is the hand as it is now
_HANGS_S = 3600.0  # beside other work a diagnosis of low priority is slow; after this long it hangs
APPEARS = ("backlash",)
"""Effects that a recalibration should not hide, however small."""


class ChangeNamer:
    """Keeps what the hand has done since a drift, and lets `twin diagnose --since` read it in a process of its own.

    What it finds becomes an event, a note beside the version and a line of the health report. `arguments` name the hand
    for the command line; `nice` is the priority of that process. Works in a thread of its own, so that the loop never
    waits for a disk.
    """

    def __init__(
        self,
        saver: RingSaver,
        service: TwinService,
        store: VersionStore,
        folder: Path,
        arguments: Sequence[str],
        nice: int,
    ) -> None:
        self._saver, self._service, self._store = saver, service, store
        self._folder, self._arguments, self._nice = folder, list(arguments), nice
        self._child: Child | None = None
        self._version, self._began_s = "", 0.0
        self._joints: list[str] = []  # that drift and were not diagnosed yet
        self._since_ns: int | None = None  # the hand's clock at the last alarm: before it, it may have been sound
        self._due_s: float | None = None
        self._seen_ns = 0
        self._guard = Guard(log)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name="twin-changes", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends a diagnosis that still runs."""
        self._stop.set()
        self._thread.join()
        child, self._child = self._child, None
        if child is not None:
            child.end()

    def _work(self) -> None:
        while not self._stop.wait(_PERIOD_S):
            self._guard.run("the diagnosis of a change", self._poll)

    def _poll(self) -> None:
        """Notices drift, begins when enough has been seen of it, takes up what has ended."""
        if not self._service.settings.name_changes:
            return
        now_s = time.monotonic()
        for event in self._service.recent_events()["events"][-20:]:
            if event["kind"] == "drift" and event["stamp_ns"] > self._seen_ns:
                self._seen_ns = event["stamp_ns"]
                self._joints.append(event["joint"])
                self._since_ns = self._service.stamp_ns
                self._due_s = now_s + _WATCHED_S
        if self._child is not None:
            self._take_up(now_s)
        elif self._due_s is not None and now_s >= self._due_s:
            self._begin(now_s)

    def _begin(self, now_s: float) -> None:
        joints, self._joints, self._due_s = self._joints, [], None
        kept = self._saver.save(self._since_ns)
        if not kept["kept"]:
            self._service.tell("changed", f"{', '.join(joints)}: what has changed is not known: {kept['why']}")
            return
        self._version, self._began_s = str(self._service.version_info["id"]), now_s
        arguments = ["diagnose", "--recording", str(kept["path"]), *self._arguments]
        arguments += ["--since", self._version, "--joints", *joints]
        arguments += ["--within", str(self._service.settings.name_changes_seconds)]
        self._child = Child(*arguments, result=self._folder / "changes.result.json", nice=self._nice)

    def _take_up(self, now_s: float) -> None:
        child = self._child
        if child is None:
            return
        if child.running:
            if now_s - self._began_s > self._service.settings.name_changes_seconds + _HANGS_S:
                child.end()
            return
        found, self._child = child.outcome(), None
        if "error" in found:
            self._service.tell("changed", f"what has changed is not known: {found['error']}")
            return
        told = {key: found[key] for key in ("verdict", "changes", "since_version")}
        if not found["changes"]:
            text = f"a joint drifts, and the change has no name: {found['verdict']}, {found['reason']}"
            self._service.tell("changed", text, told)
            return
        ratio = self._service.hand.description.alarm_ratio
        words = [change_in_words(change) for change in found["changes"]]
        loud = any(beyond(change, ratio) for change in found["changes"])
        self._service.report_changes(self._version, words)
        self._service.tell("alarm" if loud else "changed", "; ".join(words), told)
        try:
            self._store.note(self._version, f"since then: {'; '.join(words)}")
        except TwinError as error:
            log.warning("what has changed is not written beside the version: %s", error.line())


def change_in_words(change: dict[str, Any]) -> str:
    """One change of `twin diagnose --since`, with what else it may be and what to do."""
    from twin_daemon.changes.answer import rivals_in_words  # not for a start of the daemon

    rivals = f" (or {rivals_in_words(change['rivals'])}, which looks alike)" if change["rivals"] else ""
    return f"{change['words']}{rivals}; {change['remedy']}"


def beyond(change: dict[str, Any], ratio: float) -> bool:
    """Whether a change is one that following it would hide: a play that has appeared, or by more than `ratio`."""
    value = change["ratio"]["value"]
    if value is None:
        return change["effect"] in APPEARS
    return value > 0.0 and max(value, 1.0 / value) > ratio
