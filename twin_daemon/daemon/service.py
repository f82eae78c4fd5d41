"""The live twin as one object: messages in, predictions out, and what it knows as plain JSON objects.

No transport, no threads of its own. A lock makes it safe to ask from any thread while the loop feeds it.
"""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from twin_daemon.daemon import reports
from twin_daemon.daemon.drift import Alarm, Drift
from twin_daemon.daemon.events import Event, EventLog
from twin_daemon.daemon.intake import Intake, joint_ranges, wrong_with
from twin_daemon.daemon.messages import JointSample, Output, number
from twin_daemon.daemon.mirror import Mirror
from twin_daemon.daemon.one_source import Doubt, Doubts
from twin_daemon.daemon.predictor import Prediction, as_sample
from twin_daemon.daemon.ready import Ready
from twin_daemon.daemon.residual import Residual
from twin_daemon.daemon.settings import DaemonSettings
from twin_daemon.daemon.timing import Timing
from twin_daemon.simulation.twin import TwinModel

# A command whose stamp is farther than this from the hand's clock was stamped by another clock.
_CLOCK_SKEW_NS = 1_000_000_000


class TwinService:
    """One hand's live twin.

    `version` describes the model in use, as the version query answers it (at least "id"). `gate` tells what is known of
    the hand's gate, None where there is none.
    """

    def __init__(
        self,
        twin: TwinModel,
        version: dict[str, Any],
        settings: DaemonSettings | None = None,
        monotonic_s: Callable[[], float] = time.monotonic,
        wall_ns: Callable[[], int] = time.time_ns,
        journal: Path | None = None,
        gate: Callable[[], dict[str, Any] | None] | None = None,
    ) -> None:
        self.gate = gate or (lambda: None)
        self._gated = gate is not None
        self.settings = settings or DaemonSettings()
        self.hand = twin.hand
        self.namespace = twin.hand.description.namespace
        self.joints = twin.joints
        self.monotonic_s = monotonic_s
        self.wall_ns = wall_ns
        self.started_s = monotonic_s()
        self.events = EventLog(journal)
        self.timing = Timing()
        self.mirror = Mirror(twin.joints)
        self.residuals = Residual(len(twin.joints), self.settings.residual_window_s)
        self.drifts = Drift(twin.joints, self.settings.drift_false_alarms_per_day)
        self.commands_received = 0
        self.command_counts: Counter[str] = Counter()
        self.command_arrival_s: float | None = None
        self.loop: dict[str, Any] = {}
        self.changed: tuple[str, ...] = ()
        self.predicted = np.full(len(twin.joints), np.nan)
        self.stamp_ns: int | None = None
        self.intake = Intake(twin.joints, *joint_ranges(twin))
        self._last_residual_s = -np.inf
        self._was_stale = True
        self.names_source: Callable[[str], str] = repr
        self._doubts = Doubts(self.tell)
        self._lock = threading.RLock()
        self._load(Ready.made(twin, self.settings), version)
        self.tell("started", f"the twin of {self.hand.description.name} runs version {version['id']}")

    # -- in ------------------------------------------------------------------------------------------------

    def on_joint_state(self, sample: JointSample, send: Callable[[JointSample], None] | None = None) -> Output | None:
        """One decoded joint state: checked, mirrored, predicted, compared. None if nothing of it was usable.

        `send` gets the prediction before it is compared, so that nobody waits for statistics.
        """
        with self._lock:
            arrival_ns = self.wall_ns()
            accepted = self.intake.accept(sample, arrival_ns, self.monotonic_s())
            for doubt in self.intake.take_doubts():
                self._doubted(doubt)
            if accepted is None:
                return None
            if accepted.restarted:
                self.mirror.forget()
                self.residuals.clear()
                self.timing.forget()
                self.predictor.restart()
                self.tell("stamps_restarted", "the stamps of the hand start again at an earlier time")
            now_s = self.monotonic_s()
            self.mirror.update(accepted, now_s)
            following = self.predictor.state == "following"
            prediction = self.predictor.advance(accepted.stamp_ns, self.mirror.position, self.mirror.velocity)
            self.predicted, self.stamp_ns = prediction.position, accepted.stamp_ns
            predicted = as_sample(prediction, self.joints)
            try:
                if send is not None:
                    send(predicted)
            finally:
                if self.timing.add(accepted.stamp_ns, arrival_ns) == "clock_jump":
                    self.tell("clock_jump", "the hand's clock was set: its stamps jump while its messages come in step")
                self._compare(prediction, accepted.index, following)
            due = now_s - self._last_residual_s >= 1.0 / self.settings.residual_rate_hz
            if due:
                self._last_residual_s = now_s
            return Output(predicted, due)

    def _compare(self, prediction: Prediction, index: np.ndarray, following: bool) -> None:
        """What one prediction says about the model, where `index` (k,) of the joints were measured."""
        if prediction.anchored:
            self.tell("anchored", f"the model was set to the measurement ({prediction.anchored})")
            return
        residual = np.full(len(self.joints), np.nan)
        residual[index] = self.mirror.position[index] - prediction.position[index]
        self.residuals.add(prediction.stamp_ns, residual)
        if following:
            for alarm in self.drifts.add(prediction.stamp_ns, residual, prediction.velocity, prediction.touched):
                self._tell_drift(alarm)

    def _doubted(self, doubt: Doubt) -> None:
        """Says once in a while who it was, where no gate does: that has the links of all others, and names them."""
        if not self._gated:
            self._doubts.tell(doubt, self.names_source, self.monotonic_s())

    def on_command(self, sample: JointSample) -> bool:
        """One decoded command. True if the model follows it."""
        with self._lock:
            self.commands_received += 1
            kind = wrong_with(sample)
            if kind is None:
                first = self.predictor.state != "following"
                if not self.predictor.command(self._command_stamp(sample.stamp_ns), sample.names, sample.position):
                    kind = "unknown_names" if np.isfinite(sample.position).any() else "not_finite"
                elif first and self.command_arrival_s is None:
                    self.tell("commands", "the first command has been seen: the model follows the commands from here")
            if kind is not None:
                self.command_counts[kind] += 1
                return False
            self.command_arrival_s = self.monotonic_s()
            return True

    def _command_stamp(self, stamp_ns: int) -> int:
        """The moment from which a command holds, in the hand's clock."""
        latest = self.stamp_ns
        if latest is None:
            return stamp_ns
        if stamp_ns == 0:
            self.command_counts["no_stamp"] += 1
            return latest
        if abs(stamp_ns - latest) > _CLOCK_SKEW_NS:
            self.command_counts["other_clock"] += 1
            return latest
        return stamp_ns

    def refuse(self, stream: str, kind: str) -> None:
        """Counts a message of `joint_states` or `joint_commands` that could not be decoded."""
        with self._lock:
            if stream == "joint_states":
                self.intake.refuse(kind)
            else:
                self.commands_received += 1
                self.command_counts[kind] += 1

    def ready(self, twin: TwinModel) -> Ready:
        """Makes ready another model of the same joints, for `use`; from any thread, and nothing waits for it."""
        return Ready.made(twin, self.settings)

    def use(self, model: Ready, version: dict[str, Any]) -> None:
        """Goes on with another model; it starts at the next measurement."""
        if model.twin.joints != self.joints:
            raise ValueError(f"version {version['id']} has other joints than the hand in use")
        with self._lock:
            before = self.version_info["id"]
            model.predictor.inherit(self.predictor)
            self._load(model, version)
            self.retune(self.settings)  # they may be others than when it was made ready
            self.residuals.clear()
            self.drifts.clear()
            self.changed = ()
            self.tell("version", f"version {version['id']} replaces {before}")

    def retune(self, settings: DaemonSettings) -> None:
        """Goes on with other settings, as far as they can change under way: those of the keys marked live."""
        with self._lock:
            self.settings = settings
            self.predictor.retime(settings.horizon_s, settings.max_catch_up_s)

    def _load(self, model: Ready, version: dict[str, Any]) -> None:
        self.predictor, self.kinematics = model.predictor, model.kinematics
        self.version_info = version
        self.extrapolation = model.extrapolation
        self.extrapolation.use(version.get("region"))
        self._mjcf: str | None = None

    # -- out -----------------------------------------------------------------------------------------------

    def take_events(self) -> list[Event]:
        """Events since the last call. Also notices here that data have become stale, or fresh again."""
        with self._lock:
            stale = self.stale
            if stale != self._was_stale:
                self._was_stale = stale
                if stale:
                    self.tell("stale", f"no joint states for {self.settings.stale_after_s:g} s")
                else:
                    self.tell("fresh", "joint states arrive")
            return self.events.take()

    @property
    def age_s(self) -> float:
        """Seconds since any joint was last heard; infinite before the first."""
        return float(self.mirror.ages_s(self.monotonic_s()).min(initial=np.inf))

    @property
    def stale(self) -> bool:
        return self.age_s > self.settings.stale_after_s

    def state(self) -> dict[str, Any]:
        with self._lock:
            return reports.state(self)

    def residual_now(self) -> dict[str, Any]:
        with self._lock:
            return reports.residual_now(self)

    def residual(self) -> dict[str, Any]:
        with self._lock:
            return reports.residual(self)

    def health(self) -> dict[str, Any]:
        with self._lock:
            return reports.health(self)

    def drift(self) -> dict[str, Any]:
        with self._lock:
            return reports.header(self) | self.drifts.as_json()

    def recent_events(self) -> dict[str, Any]:
        with self._lock:
            return reports.header(self) | {"counts": dict(self.events.counts), "events": self.events.recent(200)}

    def version(self) -> dict[str, Any]:
        with self._lock:
            return reports.header(self) | self.version_info

    def model(self) -> dict[str, Any]:
        """The MJCF in use. Written at the first question: it takes longer than a sample may."""
        with self._lock:
            twin, version, known = self.predictor.twin, self.version_info, self._mjcf
        if known is None:
            known = twin.mjcf()
            with self._lock:
                if self.predictor.twin is twin:
                    self._mjcf = known
        return reports.header(self) | {"version": version["id"], "joints": list(twin.joints), "mjcf": known}

    def tell(self, kind: str, text: str, data: dict[str, Any] | None = None) -> None:
        """Adds an event."""
        with self._lock:
            self.events.add(self.wall_ns(), kind, text, data)

    def report_changes(self, version: str, words: Sequence[str]) -> None:
        """Says in every health report what has changed since a version, for as long as that is in use."""
        with self._lock:
            if version == self.version_info["id"]:
                self.changed = tuple(words)

    def _tell_drift(self, alarm: Alarm) -> None:
        self.tell(
            "drift",
            f"{alarm.joint} drifts from its twin: {alarm.recent_rmse_rad:.4f} rad, once {alarm.baseline_rmse_rad:.4f}",
            {
                "joint": alarm.joint,
                "since_ns": alarm.since_ns,
                "baseline_rmse_rad": number(alarm.baseline_rmse_rad),
                "recent_rmse_rad": number(alarm.recent_rmse_rad),
            },
        )
