"""When the next recalibration is due: by the clock, by hours of motion, or because a joint drifts. Times are UTC."""

from __future__ import annotations

import json
import logging
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from apscheduler.triggers.cron import CronTrigger

from twin_daemon.files import write_atomically
from twin_daemon.recalibration.settings import RecalibrationSettings, quiet_minutes

log = logging.getLogger("twin")

_LONGEST_AHEAD = timedelta(hours=1)


@dataclass(frozen=True)
class Unfinished:
    """A run that has begun, for whoever comes after a restart: why, for which joints, and from which recording (none:
    it drives the hand, and whoever wants that again asks again). `again`: it was cut short once already."""

    why: str
    joints: list[str]
    recording: str | None
    again: bool = False


class Schedule:
    """Says when a run is due and why; what it knows is kept in `path` and outlives the daemon.

    A run that was missed while the daemon was away is due at once, and several count as one. A clock that was set back
    behind the last run does not hold the next one up for longer than an hour.
    """

    def __init__(self, settings: RecalibrationSettings, path: Path, now: datetime) -> None:
        self._settings = settings
        self._path = path
        self._cron = CronTrigger.from_crontab(settings.cron, timezone="UTC") if settings.cron else None
        self._drifting: dict[str, int] = {}
        self.unfinished: Unfinished | None = None
        self.last = now
        self._not_before, self._wait = now, timedelta(0)
        self.motion_s = 0.0
        try:
            kept = json.loads(path.read_text(encoding="utf-8"))
            self.last = datetime.fromisoformat(kept["last"])
            self.motion_s = float(kept["motion_s"])
            if kept.get("unfinished") is not None:
                self.unfinished = Unfinished(**kept["unfinished"])
        except FileNotFoundError:
            self.save()
        except (OSError, ValueError, KeyError, TypeError) as error:
            log.warning("the schedule in %s cannot be read and begins anew: %s", path, error)

    def moved(self, seconds: float) -> None:
        """The hand has moved for so long."""
        self.motion_s += seconds

    def drifted(self, joint: str, since_ns: int) -> None:
        """A joint drifts, since a stamp of the hand."""
        if self._settings.on_drift:
            self._drifting.setdefault(joint, since_ns)

    @property
    def drifting(self) -> tuple[str, ...]:
        """The joints that drifted since the last run."""
        return tuple(self._drifting)

    @property
    def drifting_since_ns(self) -> int | None:
        """The stamp since which the first of them does; None where none does."""
        return min(self._drifting.values(), default=None)

    def due(self, now: datetime) -> str | None:
        """Why a run is due, in words; None while none is."""
        if self._settings.mode == "off" or self.is_quiet(now):
            return None
        if self.last > now + _LONGEST_AHEAD:
            self.last = now  # the clock was set back
        least = timedelta(minutes=self._settings.least_minutes)
        if now - self.last < least or timedelta(0) < self._not_before - now <= self._wait:
            return None
        if self._drifting:
            return f"{', '.join(self._drifting)} drifted"
        hours = self._settings.motion_hours
        if hours is not None and self.motion_s >= 3600.0 * hours:
            return f"{self.motion_s / 3600.0:.1f} h of motion"
        at = self.next(now)
        return "by the clock" if at is not None and at <= now else None

    def next(self, now: datetime) -> datetime | None:
        """When the clock alone makes the next one due; in the past where it was missed."""
        found = []
        if self._settings.mode != "off":
            if self._cron is not None:
                found.append(self._cron.get_next_fire_time(None, self.last + timedelta(seconds=1)))
            if self._settings.interval_hours is not None:
                found.append(self.last + timedelta(hours=self._settings.interval_hours))
        return min((at for at in found if at is not None), default=None)

    def begun(self, now: datetime, run: Unfinished) -> None:
        """A run has begun: everything that was due is served by it."""
        self.last, self.motion_s, self._drifting, self.unfinished = now, 0.0, {}, run
        self.save()

    def ended(self) -> None:
        """The run has ended, well or not."""
        self.unfinished = None
        self.save()

    def postponed(self, now: datetime, minutes: float = 0.0) -> None:
        """A run that was due could not begin: what was due stays so, and is tried again after `least_minutes`, or after
        `minutes` where that is later."""
        self._wait = timedelta(minutes=max(minutes, self._settings.least_minutes))
        self._not_before = now + self._wait

    def in_words(self, now: datetime) -> str:
        """When the next run is, for people."""
        settings = self._settings
        if settings.mode == "off":
            return "no recalibration by itself: recalibration.mode is off"
        said = []
        at = self.next(now)
        if at is not None:
            said.append(f"on {at:%A, %d %B at %H:%M} UTC")
        if settings.motion_hours is not None:
            left = max(settings.motion_hours - self.motion_s / 3600.0, 0.0)
            said.append(f"after {left:.1f} more hours of motion")
        if settings.on_drift:
            said.append("when a joint drifts")
        when = ", or ".join(said) or "only when it is asked for"
        return f"next recalibration ({settings.mode}) {when}" + (f"; not in {settings.quiet}" if settings.quiet else "")

    def save(self) -> None:
        """Writes the last run and the hours of motion; called now and then and at the end."""
        last, unfinished = self.last.astimezone(UTC).isoformat(), self.unfinished
        content = json.dumps(
            {
                "schema": 1,
                "last": last,
                "motion_s": self.motion_s,
                "unfinished": None if unfinished is None else asdict(unfinished),
            }
        )
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(self._path, content.encode())
        except OSError as error:
            log.warning("the schedule cannot be kept in %s: %s", self._path, error)

    def is_quiet(self, now: datetime) -> bool:
        """Whether no run begins now, scheduled or asked for."""
        if self._settings.quiet is None:
            return False
        begin, end = quiet_minutes(self._settings.quiet)
        minute = 60 * now.hour + now.minute
        return begin <= minute < end if begin <= end else minute >= begin or minute < end
