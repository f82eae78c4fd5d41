"""The gate: asked by commanders, turned by a clock, it alone lets commands out. Read-only until somebody arms it.

Every request passes the checks, every turn the trips, and every setpoint the shaper and a look ahead to where it
could come to rest. Whatever is lost (commander, hand, lease, time), the setpoints come to rest and stay.
It is software on a computer that can fail: no certified stop, and no substitute for one.
"""

from __future__ import annotations

import contextlib
import itertools
import secrets
import threading
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from twin_daemon.errors import BadInput
from twin_daemon.gate import told
from twin_daemon.gate.ahead import in_the_way, way_back
from twin_daemon.gate.checks import (
    ALLOWED,
    BEGUN,
    IDENTITY,
    MOTION,
    Asked,
    Refusal,
    Situation,
    first_refusal,
    identity_proved,
)
from twin_daemon.gate.foresight import Foresight
from twin_daemon.gate.identity import Who
from twin_daemon.gate.latch import Latch, kept_on_disk
from twin_daemon.gate.lease import Lease, Sequences
from twin_daemon.gate.let_go import LetGo, Path
from twin_daemon.gate.limits import limits_of
from twin_daemon.gate.motion import Motion, commands_of, row_of
from twin_daemon.gate.movement import Movement
from twin_daemon.gate.own import OwnCommands
from twin_daemon.gate.requests import Follow, Move, Request
from twin_daemon.gate.sendable import Sendable, make_sendable
from twin_daemon.gate.senses import Senses
from twin_daemon.gate.settings import GateSettings
from twin_daemon.gate.shaper import Shaper
from twin_daemon.gate.trips import PRESSES, Trip, Trips, Turn
from twin_daemon.simulation.twin import TwinModel

Witness = Callable[[dict[str, Any]], None]
_STREAM_S = 1.0  # targets closer than this are one stream
_RESEND_S = 0.2  # a target that is held is said again: one message may be lost
_DOUBT_S = 2.0  # after the last sign of it
_GRACE_S = 0.5  # for another source to notice that it is no longer the only one


class Gate:
    """`witness` gets every decision as a plain object before it takes effect; an OSError of it means refused. It is
    called under the gate's lock and must wait for nobody. With a `latch` a stop outlives the process: a gate whose
    latch is set begins stopped.

    Times are of a monotonic clock, `wall_ns` of the clock that stamps come from. Safe to use from several threads.
    """

    def __init__(
        self,
        twin: TwinModel,
        settings: GateSettings,
        witness: Witness = lambda _: None,
        session: str | None = None,
        latch: Latch | None = None,
    ) -> None:
        self.settings = settings
        self.session = session or secrets.token_hex(8)
        self.limits = limits_of(twin.hand, settings)
        self._hand = twin.hand
        self.witness = witness
        self._dt_s = 1.0 / settings.rate_hz
        self._asking, self._lock = threading.Lock(), threading.RLock()
        self._shaper = Shaper(self.limits)
        self._trips = Trips(twin.hand, settings)
        self._mode = "read_only"
        self._lease: Lease | None = None
        self._sequences = Sequences()
        self._ended, self._latch = "", latch
        if latch is not None and latch.why is not None:
            self._mode, self._ended = "stopped", latch.why
        self._generation = 0
        self._motion: Motion | None = None
        self._last_turn_s: float | None = None
        self._own = OwnCommands()
        self.clock: Callable[[], float] = lambda: -np.inf  # planning is not the commander's silence
        self.outlet = ""
        self.names_source: Callable[[str], str] = repr
        self._sent_s = self._first_sent_s = -np.inf
        self._sent_row = np.full(len(self.limits.names), np.nan)
        self._named: tuple[bytes, tuple[str, ...]] = b"", ()
        self._is_last = False  # whether the hand's last command was the gate's
        self._letting_go: LetGo | None = None
        self._doubt, self._doubt_s = "", -np.inf
        self._path = Path(len(self.limits.names))
        self._number = self._stamp_ns = 0
        self._streamed_s = -np.inf
        self._senses = Senses(twin, self.limits, settings)
        self.movement = Movement(twin.joints)
        self.use(self.foresight(twin))

    def foresight(self, twin: TwinModel) -> Foresight:
        """What this gate looks ahead and rehearses with, of another model of the hand. Takes some milliseconds."""
        return Foresight.of(twin, self.limits, self.settings)

    def use(self, foresight: Foresight) -> None:
        """Looks ahead and rehearses with this from now on."""
        with self._lock:
            self._ahead, self._planner, self._expected = foresight.preview, foresight.planner, foresight.expected

    # -- what is seen of the hand --------------------------------------------------------------------------

    def measured(self, position: np.ndarray, arrival_s: np.ndarray, effort: Mapping[str, float] | None = None) -> None:
        """Where the joints (j,) were last measured, rad, and when that arrived, s. Waits for nobody."""
        self._senses.measured(position, arrival_s, effort)
        self.movement.add(position, float(arrival_s.max(initial=-np.inf)))

    def seen(
        self, stamp_ns: int, names: tuple[str, ...], position: np.ndarray, now_s: float, source: str | None = None
    ) -> None:
        """A command on its way to the hand. One that is not the gate's own ends what the gate does: it has another
        content than what was sent, or comes from another `source` than the `outlet` (None: it may be an echo). One that
        cannot be read is somebody else's, too: what the hand makes of it nobody knows."""
        elsewhere = source is not None and bool(self.outlet) and source != self.outlet
        if not elsewhere and self._own.holds(stamp_ns, names, position, now_s):
            return
        with self._lock:
            with contextlib.suppress(BadInput, ValueError):
                row = commands_of(self._hand, dict(zip(names, position.tolist(), strict=True)))
                self._senses.told(row_of(self.limits, row))
            self._is_last = False
            if self._mode == "armed" and now_s > self._first_sent_s + _GRACE_S > 0.0:
                by = f": {self.names_source(source)}" if source else ""
                self._end(Trip("foreign", f"somebody else sends commands to this hand, past the gate{by}"), now_s)

    # -- requests ------------------------------------------------------------------------------------------

    def ask(self, verb: str, request: Request, who: Who | None, now_s: float, wall_ns: int) -> dict[str, Any]:
        """Whether a request is accepted, and why not. None for `who` is somebody whose proof was wrong."""
        # planning takes time, and a stop must not wait for it
        with self._asking if verb in MOTION else contextlib.nullcontext():
            asked = self._asked(verb, request, who, wall_ns)
            dry = isinstance(request, (Move, Follow)) and request.dry_run
            with self._lock:
                situation, generation = self._situation(asked, now_s), self._generation
                measured, planner = self._senses.pose, self._planner
                refusal = self._identified(asked, situation, dry)
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
        kept = kept_on_disk(self._latch, answer["gate"]["ended"], lambda: self._mode == "stopped")
        return answer | {"latched": True, "was_driving": was_driving} | kept

    def _asked(self, verb: str, request: Request, who: Who | None, wall_ns: int) -> Asked:
        return Asked(
            verb=verb,
            who=who,
            session=request.session,
            sequence=request.sequence,
            age_s=(wall_ns - request.stamp_ns) * 1e-9,
            ahead_s=(request.sequence - wall_ns) * 1e-9,
            lease=request.lease,
            reason=getattr(request, "reason", ""),
            lease_s=getattr(request, "lease_s", None) or self.settings.lease_s,
        )

    def _held_by(self, asked: Asked) -> Lease | None:
        """The lease, if the request carries it."""
        lease = self._lease
        return lease if lease and asked.who and lease.is_held(asked.who.name, asked.lease) else None

    def _identified(self, asked: Asked, situation: Situation, dry: bool) -> Refusal | None:
        """Who asks, and whether it is new. In one step with the look at the last sequence, under the lock: verbs are
        asked in threads of their own, and of a request that comes twice only the first may count."""
        if dry:
            return identity_proved(asked, situation)
        if asked.verb == "stop":  # anybody may stop: one that is refused for want of a key hurts
            return None
        refusal = first_refusal(IDENTITY, asked, situation)
        if refusal is None and asked.who is not None:
            self._sequences.take(asked.who.name, self._held_by(asked), asked.sequence)
        return refusal

    def _decide(self, asked: Asked, refusal: Refusal | None, generation: int, now_s: float) -> dict[str, Any]:
        with self._lock:
            if refusal is None and generation != self._generation and asked.verb != "stop":
                refusal = Refusal("changed", f"meanwhile the gate has changed: {self._ended or self._mode}")
            if refusal is None and asked.motion is not None:
                refusal = first_refusal(BEGUN, asked, self._situation(asked, now_s))
            try:
                self._record(asked, refusal, now_s)
            except OSError as error:
                if asked.verb not in ("stop", "disarm"):  # what makes safe happens, recorded or not
                    refusal = Refusal(
                        "record", f"the audit log cannot be written: {error.strerror}", "a disk with room"
                    )
            if refusal is None and asked.verb == "release" and self._latch is not None:
                try:
                    self._latch.clear()
                except OSError as error:
                    refusal = Refusal("latch", f"the latch cannot be removed: {error.strerror}", "a disk that works")
            if refusal is None:
                self._do(asked, now_s)
            answer = self._answer(asked, refusal, now_s)
            if refusal is None and asked.verb == "arm" and self._lease is not None:
                answer["lease"] = self._lease.token  # for whoever has armed, and told to nobody else
            return answer

    def _do(self, asked: Asked, now_s: float) -> None:
        held = self._held_by(asked)
        if held is not None:  # whoever does not hold the lease does not keep it alive
            held.beat(now_s)
        if asked.verb == "arm" and asked.who is not None:
            if held is not None:
                held.until_s, held.reason = now_s + asked.lease_s, asked.reason
            else:
                self._lease = Lease(asked.who.name, asked.reason, now_s + asked.lease_s, now_s, asked.sequence)
            self._mode, self._ended = "armed", ""
            self._first_sent_s = -np.inf
            if not self._shaper.is_given:  # what still lets go may need the whole way back
                self._path = Path(len(self.limits.names))
                self._trips.forget()  # else what is behind has been so before: arming anew buys it no time
            if self._shaper.still:  # else the turns go on, and with them the time between two
                self._last_turn_s = now_s
        elif asked.verb == "disarm":
            self._end(Trip("disarmed", "disarmed by its commander"), now_s, tell=False)
        elif asked.verb == "stop":
            name = asked.who.name if asked.who is not None else "somebody"
            why = f"stopped by {name}" + (f": {asked.reason}" if asked.reason else "")
            self._end(Trip("stopped", why), now_s, tell=False)
            self._mode = "stopped"
        elif asked.verb == "release":
            self._mode, self._ended = "read_only", ""
        elif asked.motion is not None:
            start, fresh = self._start(), asked.motion.moved & ~self._shaper.given
            self._shaper.begin(np.where(fresh, start, np.nan))
            if self._expected.running and fresh.any():
                self._expected.place(fresh, self._senses.pose, start)
            self._motion = asked.motion
            self._letting_go = None

    # -- turns ---------------------------------------------------------------------------------------------

    @property
    def active(self) -> bool:
        """Whether turns are needed: the gate is armed, or something still comes to rest or lets go."""
        return self._mode == "armed" or not self._shaper.still or self._letting_go is not None

    @property
    def driving(self) -> bool:
        """Whether commands of this gate are under way."""
        return self._motion is not None or not self._shaper.still

    def turn(self, now_s: float, wall_ns: int) -> Sendable | None:
        """One turn of the clock; the command to send, if there is one."""
        with self._lock:
            if not self.active:
                self._forget()
                self._last_turn_s = None
                return None
            since_s = self._dt_s if self._last_turn_s is None else now_s - self._last_turn_s
            self._last_turn_s = now_s
            if self._mode == "armed":
                trip = self._trips.look(self._seen_turn(now_s, since_s))
                if trip is not None:
                    self._end(trip, now_s)
            dt_s = min(max(since_s, 0.0), self._dt_s)
            if dt_s > 0.0:
                self._move(dt_s, now_s)
                self._expect(since_s, now_s)
            return self._send(now_s, wall_ns)

    def _forget(self) -> None:
        self._shaper.forget()
        self._expected.forget()
        self._trips.forget()
        self._letting_go = None

    def _expect(self, since_s: float, now_s: float) -> None:
        """The twin goes on beside the hand; where it failed, or was exchanged, it begins where the hand is."""
        if not self._shaper.is_given:
            return
        if not self._expected.running:
            self._expected.begin(self._senses.pose, self._start())
            self._trips.forget()
        self._expected.advance(self._shaper.position, since_s)
        self._path.add(self._shaper.position, self._senses.by_command())
        self._trips.sent(now_s, self._shaper.position.copy(), self._expected.reading)

    def _move(self, dt_s: float, now_s: float) -> None:
        shaper, rest = self._shaper, np.full(len(self.limits.names), np.nan)
        motion = self._motion
        goal = rest if motion is None else motion.advance(dt_s)
        if self._letting_go is None:
            position, velocity = shaper.toward(goal, dt_s)
        else:
            goal = self._letting_go.follow(self._believed(now_s), now_s)
            pose, now = self._senses.pose, self._start()
            position, velocity, short = way_back(self._ahead, shaper, pose, now, goal, dt_s)
            if self._letting_go.is_done(shaper.position, now_s, short):
                if self._ended and short.any():
                    self._ended += told.not_back(self.limits.names, self._letting_go.left(shaper.position))
                self._letting_go = None
                self._trips.forget()
        if motion is not None and velocity.any():
            now = self._start()
            then = np.where(shaper.given, shaper.stopping(position, velocity), now)
            trip = in_the_way(self._ahead, self._trips, self._senses.pose, now, then)
            if trip is not None:
                self._end(trip, now_s)
                position, velocity = shaper.toward(rest, dt_s)
        shaper.take(position, velocity)
        # a motion is not done while the hand stays behind
        if self._motion is not None and self._motion.over(position, shaper.still) and not self._trips.suspects:
            self._motion, self._ended = None, "done"

    def _send(self, now_s: float, wall_ns: int) -> Sendable | None:
        given = self._shaper.given
        if not self._shaper.is_given:
            return None
        row = self._shaper.position
        position = row[given]
        if np.array_equal(position, self._sent_row[given]) and now_s - self._sent_s < _RESEND_S:
            return None
        self._number += 1
        self._stamp_ns = max(wall_ns, self._stamp_ns + 1)
        self._sent_row, self._sent_s, self._is_last = row.copy(), now_s, True
        self._senses.told(row)
        if self._first_sent_s < 0.0:
            self._first_sent_s = now_s
        names = self._names_of(given)
        self._own.sent(self._stamp_ns, names, position, now_s)
        return make_sendable(self._number, self._stamp_ns, names, position)

    def _names_of(self, given: np.ndarray) -> tuple[str, ...]:
        if self._named[0] != (which := given.tobytes()):
            self._named = which, tuple(itertools.compress(self.limits.names, given))
        return self._named[1]

    def _end(self, trip: Trip, now_s: float, tell: bool = True) -> None:
        """The lease and the motion end; the turns that follow bring the setpoints to rest."""
        self._generation += 1
        self._motion, self._ended = None, trip.why
        lease, self._lease = self._lease, None
        who = lease.name if lease is not None else None
        if self._mode == "armed":
            self._mode = "read_only"
        if trip.kind in PRESSES and self.settings.after_trip == "let_go":
            self._let_go(now_s)
        if tell:
            # the hand comes to rest whether this can be written or not
            with contextlib.suppress(OSError):
                self.witness({"verb": "trip", "who": who, "accepted": True, "check": trip.kind, "why": trip.why})

    def _let_go(self, now_s: float) -> None:
        """The setpoints go to where the hand is, so that it presses against nothing. Where they were given up already
        the hand still holds the last of them."""
        shaper = self._shaper
        given = shaper.given
        rest = np.where(given, shaper.stopping(shaper.position, shaper.velocity), self._sent_row)
        low, high = self._path.bounds()
        bounds = np.maximum(low, self.limits.lower), np.minimum(high, self.limits.upper)
        found = LetGo(rest, self._believed(now_s), self.limits.margin, bounds, now_s)
        if not shaper.is_given:
            if not self._is_last or not found.is_needed:
                return
            shaper.begin(rest)
            self._last_turn_s = None
        self._letting_go = found

    def _believed(self, now_s: float) -> np.ndarray:
        """(c,) rad where the hand is, NaN where it is not heard or its readings cannot be. Where those of several
        joints cannot be it is no sensor's fault but the driver's, and none is believed."""
        heard = self._senses.ages_s(now_s) <= self.settings.state_timeout_s
        if len(self._senses.doubts(now_s)) > 1:
            heard = np.zeros_like(heard)
        return np.where(heard & ~self._senses.doubted(now_s), self._senses.by_command(), np.nan)

    def doubt(self, kind: str, why: str, now_s: float) -> None:
        """What is told of the hand may not be the hand's: the lease ends, and nobody arms in the next seconds."""
        with self._lock:
            self._doubt, self._doubt_s = why, now_s
            self.end(kind, why, now_s)

    def end(self, kind: str, why: str, now_s: float) -> None:
        """Ends the lease for a reason of the gate's keeper, and brings what moves to rest."""
        with self._lock:
            if self._mode == "armed":
                self._end(Trip(kind, why), now_s)

    def fault(self, why: str, now_s: float) -> None:
        """The gate itself has failed: nothing more is sent, and the hand stays at its last target."""
        with self._lock:
            self.end("fault", why, now_s)
            self._forget()

    # -- what is known -------------------------------------------------------------------------------------

    def status(self, now_s: float) -> dict[str, Any]:
        """Mode, commander, lease and motion as a plain object."""
        with self._lock:
            motion, lease = self._motion, self._lease
            return {
                "mode": self._mode,
                "session": self.session,
                "commander": None if lease is None else lease.name,
                "reason": None if lease is None else lease.reason,
                "lease_left_s": None if lease is None else max(lease.until_s - now_s, 0.0),
                "motion": None if motion is None else motion.name,
                "moving": self.driving,
                "elapsed_s": None if motion is None else motion.elapsed_s,
                "duration_s": None if motion is None else motion.duration_s,
                "ended": self._ended or None,
                "heartbeat_s": self.settings.heartbeat_s,
                "commands_sent": self._number,
                "certified": False,
            }

    def _situation(self, asked: Asked, now_s: float) -> Situation:
        held, name = self._held_by(asked), "" if asked.who is None else asked.who.name
        start = self._start()
        return Situation(
            mode=self._mode,
            commander=None if self._lease is None else self._lease.name,
            held=held is not None,
            lease_left_s=0.0 if self._lease is None else self._lease.until_s - now_s,
            stopped_because=self._ended or None,
            session=self.session,
            last_sequence=self._sequences.last(name, held),
            limits=self.limits,
            settings=self.settings,
            setpoint=start,
            given=self._shaper.given,
            away=lambda: self._senses.farthest(start, now_s),
            doubts=self._senses.doubts(now_s),
            age_s=self._senses.ages_s(now_s),
            letting_go=self._letting_go is not None and self._letting_go.is_needed,
            doubt=self._doubt if now_s - self._doubt_s <= _DOUBT_S else None,
        )

    def _start(self) -> np.ndarray:
        return self._senses.start(self._shaper.position)

    def _seen_turn(self, now_s: float, since_s: float) -> Turn:
        lease, arrival_s = self._lease, self._senses.arrivals_s()
        return Turn(
            now_s=now_s,
            since_last_turn_s=since_s,
            lease_left_s=0.0 if lease is None else lease.until_s - now_s,
            commander_silent_s=now_s - lease.beat_s if lease is not None and self._motion is not None else 0.0,
            commander_patience_s=lease.patience_s(self.settings) if lease is not None else np.inf,
            names=self.limits.names,
            setpoint=self._shaper.position,
            measured=self._senses.by_command(),
            arrival_s=arrival_s,
            age_s=now_s - arrival_s,
            effort=self._senses.effort,
            doubts=self._senses.doubts(now_s),
            letting_go=self._letting_go is not None,
        )

    def _record(self, asked: Asked, refusal: Refusal | None, now_s: float) -> None:
        if asked.verb == "beat" and refusal is None:
            return
        if asked.verb == "target" and refusal is None:
            streamed_s, self._streamed_s = self._streamed_s, now_s
            if now_s - streamed_s < _STREAM_S:
                return  # a stream is recorded when it begins
        warnings = self._warnings(asked, refusal) or None
        again = True if asked.verb == "stop" and self._mode == "stopped" else None
        self.witness(told.entry(asked, refusal) | {"warnings": warnings, "again": again})

    def _warnings(self, asked: Asked, refusal: Refusal | None) -> list[str]:
        if asked.verb != "arm" or refusal is not None:
            return []
        return told.warnings(self._hand, self._trips.effort_limit, self._senses.effort)

    def _answer(self, asked: Asked, refusal: Refusal | None, now_s: float) -> dict[str, Any]:
        warnings = self._warnings(asked, refusal)
        return told.reply(asked, refusal) | {"warnings": warnings, "gate": self.status(now_s)}
