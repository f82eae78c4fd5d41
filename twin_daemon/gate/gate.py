"""The gate: asked by commanders, turned by a clock, it alone lets commands out. Read-only until somebody arms it.

Every request passes the checks, every turn the monitor, and every setpoint the shaper and a look ahead to where it
could come to rest. Whatever is lost (commander, hand, lease, time), the setpoints come to rest and stay.
It is software on a computer that can fail: no certified stop, and no substitute for one.
"""

from __future__ import annotations

import contextlib
import secrets
import threading
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from twin_daemon.errors import BadInput
from twin_daemon.gate import told
from twin_daemon.gate.asked import Asked, Refusal, Situation
from twin_daemon.gate.authority import Authority
from twin_daemon.gate.checks import (
    ALLOWED,
    BEGUN,
    MOTION,
    first_refusal,
)
from twin_daemon.gate.command_output import CommandOutput
from twin_daemon.gate.drive import DONE, Drive
from twin_daemon.gate.feedback import Feedback
from twin_daemon.gate.hand_model import HandModel
from twin_daemon.gate.latch import Latch, kept_on_disk
from twin_daemon.gate.limits import limits_of
from twin_daemon.gate.motion import commands_of, row_of
from twin_daemon.gate.motion_monitor import PRESSES, MotionMonitor, ProtectiveStop, Turn
from twin_daemon.gate.movement import Movement
from twin_daemon.gate.requests import Follow, Move, Request
from twin_daemon.gate.sendable import Sendable
from twin_daemon.gate.settings import GateSettings
from twin_daemon.security.identity import Who
from twin_daemon.simulation.twin import TwinModel

AuditSink = Callable[[dict[str, Any]], None]
_GRACE_S = 0.5  # for another source to notice that it is no longer the only one


class Gate:
    """`audit_sink` gets every decision as a plain object before it takes effect; an OSError of it means refused. It is
    called under the gate's lock and must wait for nobody. With a `latch` a stop outlives the process: a gate whose
    latch is set begins stopped.

    Times are of a monotonic clock, `wall_ns` of the clock that stamps come from. Safe to use from several threads.
    """

    def __init__(
        self,
        twin: TwinModel,
        settings: GateSettings,
        audit_sink: AuditSink = lambda _: None,
        session: str | None = None,
        latch: Latch | None = None,
    ) -> None:
        self.settings = settings
        self.session = session or secrets.token_hex(8)
        self.limits = limits_of(twin.hand, settings)
        self._hand = twin.hand
        self.audit_sink = audit_sink
        self._dt_s = 1.0 / settings.rate_hz
        self._asking, self._lock = threading.Lock(), threading.RLock()
        self._latch = latch
        self._authority = Authority(settings, latch)
        self._last_turn_s: float | None = None
        self.clock: Callable[[], float] = lambda: -np.inf  # planning is not the commander's silence
        self.own_source = ""
        self.names_source: Callable[[str], str] = repr
        self._stream = told.Stream()
        self._feedback = Feedback(twin, self.limits, settings)
        self._monitor = MotionMonitor(twin.hand, settings)
        hand_model = self.hand_model(twin)
        self._planner = hand_model.planner
        self._drive = Drive(self.limits, settings, self._feedback, self._monitor, hand_model, self._end)
        self._out = CommandOutput(self.limits.names)
        self.movement = Movement(twin.joints)

    def hand_model(self, twin: TwinModel) -> HandModel:
        """What this gate looks ahead and rehearses with, of another model of the hand. Takes some milliseconds."""
        return HandModel.of(twin, self.limits, self.settings)

    def use(self, hand_model: HandModel) -> None:
        """Looks ahead and rehearses with this from now on."""
        with self._lock:
            self._planner = hand_model.planner
            self._drive.use(hand_model)

    # -- what is seen of the hand --------------------------------------------------------------------------

    def measured(self, position: np.ndarray, arrival_s: np.ndarray, effort: Mapping[str, float] | None = None) -> None:
        """Where the joints (j,) were last measured, rad, and when that arrived, s. Waits for nobody."""
        self._feedback.measured(position, arrival_s, effort)
        self.movement.add(position, float(arrival_s.max(initial=-np.inf)))

    def seen(
        self, stamp_ns: int, names: tuple[str, ...], position: np.ndarray, now_s: float, source: str | None = None
    ) -> None:
        """A command on its way to the hand. One that is not the gate's own ends what the gate does: it has another
        content than what was sent, or comes from another `source` than `own_source` (None: it may be an echo). One that
        cannot be read is somebody else's, too: what the hand makes of it nobody knows."""
        elsewhere = source is not None and bool(self.own_source) and source != self.own_source
        if not elsewhere and self._out.is_own(stamp_ns, names, position, now_s):
            return
        with self._lock:
            with contextlib.suppress(BadInput, ValueError):
                row = commands_of(self._hand, dict(zip(names, position.tolist(), strict=True)))
                self._feedback.told(row_of(self.limits, row))
            self._out.is_last = False
            if self._authority.is_armed and now_s > self._out.first_s + _GRACE_S > 0.0:
                by = f": {self.names_source(source)}" if source else ""
                self._end(
                    ProtectiveStop("foreign", f"somebody else sends commands to this hand, past the gate{by}"), now_s
                )

    # -- requests ------------------------------------------------------------------------------------------

    def ask(self, verb: str, request: Request, who: Who | None, now_s: float, wall_ns: int) -> dict[str, Any]:
        """Whether a request is accepted, and why not. None for `who` is somebody whose proof was wrong."""
        # planning takes time, and a stop must not wait for it
        with self._asking if verb in MOTION else contextlib.nullcontext():
            asked = Asked.of(verb, request, who, wall_ns, self.settings)
            dry = isinstance(request, (Move, Follow)) and request.dry_run
            with self._lock:
                situation, generation = self._situation(asked, now_s), self._authority.generation
                measured, planner = self._feedback.pose, self._planner
                refusal = self._authority.identified(asked, situation, dry)
            if refusal is None and not dry:
                refusal = first_refusal(ALLOWED[verb], asked, situation)
            if refusal is None and verb in MOTION:
                try:
                    asked = planner.plan(asked, request, situation.setpoint, measured)
                except BadInput as error:
                    refusal = Refusal("request", error.line().rstrip("."))
                else:
                    refusal = first_refusal(MOTION[verb], asked, situation)
            if dry:
                motion = asked.motion if refusal is None else None
                found = None if motion is None else planner.rehearse(motion, situation.setpoint, measured)
                return self._answer(asked, refusal, now_s) | {"dry_run": True, "rehearsal": found}
            was_driving = self.driving
            answer = self._decide(asked, refusal, generation, max(now_s, self.clock()))
        if verb != "stop":
            return answer
        # not under the lock: the setpoints come to rest meanwhile, however slow the disk is
        kept = kept_on_disk(self._latch, answer["gate"]["ended"], lambda: self._authority.mode == "stopped")
        return answer | {"latched": True, "was_driving": was_driving} | kept

    def _decide(self, asked: Asked, refusal: Refusal | None, generation: int, now_s: float) -> dict[str, Any]:
        with self._lock:
            if refusal is None and generation != self._authority.generation and asked.verb != "stop":
                refusal = Refusal(
                    "changed", f"meanwhile the gate has changed: {self._authority.ended or self._authority.mode}"
                )
            if refusal is None and asked.motion is not None:
                refusal = first_refusal(BEGUN, asked, self._situation(asked, now_s))
            try:
                self._record(asked, refusal, now_s)
            except OSError as error:
                if asked.verb not in ("stop", "disarm"):  # what makes safe happens, recorded or not
                    refusal = Refusal(
                        "record", f"the audit log cannot be written: {error.strerror}", "a disk with room"
                    )
            if refusal is None and asked.verb == "release":
                refusal = self._authority.unlatch()
            if refusal is None:
                self._do(asked, now_s)
            answer = self._answer(asked, refusal, now_s)
            if refusal is None and asked.verb == "arm" and self._authority.lease is not None:
                answer["lease"] = self._authority.lease.token  # for whoever has armed, and told to nobody else
            return answer

    def _do(self, asked: Asked, now_s: float) -> None:
        held = self._authority.held_by(asked)
        if held is not None:  # whoever does not hold the lease does not keep it alive
            held.beat(now_s)
        if asked.verb == "arm" and asked.who is not None:
            self._authority.arm(asked, asked.who.name, now_s)
            self._out.armed()
            self._drive.armed()
            if self._drive.shaper.still:  # else the turns go on, and with them the time between two
                self._last_turn_s = now_s
        elif asked.verb == "disarm":
            self._end(ProtectiveStop("disarmed", "disarmed by its commander"), now_s, tell=False)
        elif asked.verb == "stop":
            name = asked.who.name if asked.who is not None else "somebody"
            why = f"stopped by {name}" + (f": {asked.reason}" if asked.reason else "")
            self._end(ProtectiveStop("stopped", why), now_s, tell=False)
            self._authority.stop()
        elif asked.verb == "release":
            self._authority.release()
        elif asked.motion is not None:
            self._drive.begin(asked.motion)

    # -- turns ---------------------------------------------------------------------------------------------

    @property
    def active(self) -> bool:
        """Whether turns are needed: the gate is armed, or something still comes to rest or lets go."""
        return self._authority.is_armed or self._drive.is_active

    @property
    def driving(self) -> bool:
        """Whether commands of this gate are under way."""
        return self._drive.is_under_way

    def turn(self, now_s: float, wall_ns: int) -> Sendable | None:
        """One turn of the clock; the command to send, if there is one."""
        with self._lock:
            if not self.active:
                self._drive.forget()
                self._last_turn_s = None
                return None
            since_s = self._dt_s if self._last_turn_s is None else now_s - self._last_turn_s
            self._last_turn_s = now_s
            if self._authority.is_armed:
                stop = self._monitor.check(self._seen_turn(now_s, since_s))
                if stop is not None:
                    self._end(stop, now_s)
            dt_s = min(max(since_s, 0.0), self._dt_s)
            if dt_s > 0.0:
                word = self._drive.advance(dt_s, now_s)
                if word == DONE:
                    self._authority.ended = word
                elif word is not None and self._authority.ended:
                    self._authority.ended += f"; {word}"
                self._drive.expect(since_s, now_s)
            sent = self._out.send(self._drive.shaper, now_s, wall_ns)
            if sent is not None:
                self._feedback.told(self._out.row)
            return sent

    def _end(self, stop: ProtectiveStop, now_s: float, tell: bool = True) -> None:
        """The lease and the motion end; the turns that follow bring the setpoints to rest."""
        who = self._authority.end(stop.why)
        self._drive.end()
        presses = stop.kind in PRESSES and self.settings.after_trip == "let_go"
        if presses and self._drive.let_go(self._out.row, self._out.is_last, now_s):
            self._last_turn_s = None  # a first turn is as long as any
        if tell:
            # the hand comes to rest whether this can be written or not
            with contextlib.suppress(OSError):
                self.audit_sink({"verb": "trip", "who": who, "accepted": True, "check": stop.kind, "why": stop.why})

    def doubt(self, kind: str, why: str, now_s: float) -> None:
        """What is told of the hand may not be the hand's: the lease ends, and nobody arms in the next seconds."""
        with self._lock:
            self._authority.doubt(why, now_s)
            self.end(kind, why, now_s)

    def end(self, kind: str, why: str, now_s: float) -> None:
        """Ends the lease for a reason of the gate's keeper, and brings what moves to rest."""
        with self._lock:
            if self._authority.is_armed:
                self._end(ProtectiveStop(kind, why), now_s)

    def fault(self, why: str, now_s: float) -> None:
        """The gate itself has failed: nothing more is sent, and the hand stays at its last target."""
        with self._lock:
            self.end("fault", why, now_s)
            self._drive.forget()

    # -- what is known -------------------------------------------------------------------------------------

    def status(self, now_s: float) -> dict[str, Any]:
        """Mode, commander, lease and motion as a plain object."""
        with self._lock:
            motion, lease = self._drive.motion, self._authority.lease
            return {
                "mode": self._authority.mode,
                "session": self.session,
                "commander": None if lease is None else lease.name,
                "reason": None if lease is None else lease.reason,
                "lease_left_s": None if lease is None else max(lease.until_s - now_s, 0.0),
                "motion": None if motion is None else motion.name,
                "moving": self.driving,
                "elapsed_s": None if motion is None else motion.elapsed_s,
                "duration_s": None if motion is None else motion.duration_s,
                "ended": self._authority.ended or None,
                "heartbeat_s": self.settings.heartbeat_s,
                "commands_sent": self._out.number,
                "certified": False,
            }

    def _situation(self, asked: Asked, now_s: float) -> Situation:
        letting_go, lease = self._drive.letting_go, self._authority.lease
        start = self._drive.start()
        return Situation(
            mode=self._authority.mode,
            commander=None if lease is None else lease.name,
            held=self._authority.held_by(asked) is not None,
            lease_left_s=self._authority.lease_left_s(now_s),
            stopped_because=self._authority.ended or None,
            session=self.session,
            last_sequence=self._authority.last_sequence(asked),
            limits=self.limits,
            settings=self.settings,
            setpoint=start,
            given=self._drive.shaper.given,
            away=lambda: self._feedback.farthest(start, now_s),
            doubts=self._feedback.doubts(now_s),
            age_s=self._feedback.ages_s(now_s),
            letting_go=letting_go is not None and letting_go.is_needed,
            doubt=self._authority.doubted(now_s),
        )

    def start(self) -> np.ndarray:
        """(c,) rad: where a motion would begin."""
        return self._drive.start()

    @property
    def letting_go(self) -> bool:
        """Whether the setpoints go back to where the hand is, or follow it."""
        return self._drive.letting_go is not None

    def _seen_turn(self, now_s: float, since_s: float) -> Turn:
        arrival_s = self._feedback.arrivals_s()
        return Turn(
            now_s=now_s,
            since_last_turn_s=since_s,
            lease_left_s=self._authority.lease_left_s(now_s),
            commander_silent_s=0.0 if self._drive.motion is None else self._authority.silent_s(now_s),
            commander_patience_s=self._authority.patience_s(),
            names=self.limits.names,
            setpoint=self._drive.shaper.position,
            measured=self._feedback.by_command(),
            arrival_s=arrival_s,
            age_s=now_s - arrival_s,
            effort=self._feedback.effort,
            doubts=self._feedback.doubts(now_s),
            letting_go=self.letting_go,
        )

    def _record(self, asked: Asked, refusal: Refusal | None, now_s: float) -> None:
        if self._stream.goes_on(asked, refusal, now_s):
            return
        warnings = self._warnings(asked, refusal) or None
        again = True if asked.verb == "stop" and self._authority.mode == "stopped" else None
        self.audit_sink(told.entry(asked, refusal) | {"warnings": warnings, "again": again})

    def _warnings(self, asked: Asked, refusal: Refusal | None) -> list[str]:
        if asked.verb != "arm" or refusal is not None:
            return []
        return told.warnings(self._hand, self._monitor.effort_limit, self._feedback.effort)

    def _answer(self, asked: Asked, refusal: Refusal | None, now_s: float) -> dict[str, Any]:
        warnings = self._warnings(asked, refusal)
        return told.reply(asked, refusal) | {"warnings": warnings, "gate": self.status(now_s)}
