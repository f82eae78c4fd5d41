"""What goes wrong around a gate in `bench.gate_streams`: blocked fingers, sensors that lie, a second source."""

from __future__ import annotations

import numpy as np

from twin_daemon.daemon.one_source import OneSource
from twin_daemon.gate.gate import Gate
from twin_daemon.gate.limits import Limits
from twin_daemon.gate.motion_monitor import PRESSES
from twin_daemon.gate.readings import RECENT_S
from twin_daemon.hand.schema import CommandInfo
from twin_daemon.simulation.twin import TwinModel

KINDS = ("none", "degrees", "frozen", "reversed", "blocked", "blocked", "second source")
_LET_GO_S = 1.5  # for the setpoints to go back, and to follow what springs back
_EPS_RAD = 1e-6
_ROOM_RAD = 0.7


def _alone(twin: TwinModel) -> dict[str, CommandInfo]:
    """The commands that drive one joint."""
    return {name: info for name, info in twin.hand.description.commands.items() if len(info.joints) == 1}


class Fault:
    """One thing that is wrong from some moment on, with one command's joint. Poses are (j,) rad."""

    def __init__(self, twin: TwinModel, rng: np.random.Generator) -> None:
        self.kind = str(rng.choice(KINDS))
        reach = {name: twin.hand.joint_range_rad[info.joints[0]][1] for name, info in _alone(twin).items()}
        alone = [name for name, most in reach.items() if most > _ROOM_RAD]  # which can be sent beyond a contact
        self.command = str(rng.choice(alone))
        self.joint = twin.joints.index(twin.hand.description.commands[self.command].joints[0])
        self.wall: float | None = None
        self._rng, self._sources = rng, OneSource()
        self._frozen: float | None = None
        self.begun = False

    def maybe_begin(self, pose: np.ndarray) -> None:
        """Begins now or never, or later: in one of forty turns."""
        if self.begun or self.kind == "none" or self._rng.random() > 0.025:
            return
        self.begun = True
        if self.kind == "blocked":
            self.wall = float(pose[self.joint]) + float(self._rng.uniform(0.0, 0.3))
        self._frozen = float(pose[self.joint])

    def held(self, pose: np.ndarray) -> None:
        """Keeps a blocked joint where it is blocked."""
        if self.wall is not None:
            pose[self.joint] = min(pose[self.joint], self.wall)

    def said(self, pose: np.ndarray) -> np.ndarray:
        """What the sensors say of a pose."""
        said = pose.copy()
        if not self.begun:
            return said
        if self.kind == "degrees":
            return np.degrees(said)
        if self.kind == "frozen" and self._frozen is not None:
            said[self.joint] = self._frozen
        if self.kind == "reversed":
            said[self.joint] *= -1.0
        return said

    def speak_beside(self, gate: Gate, now_s: float) -> None:
        """A second source of states, as a gate's intake judges it."""
        if self.kind != "second source":
            return
        for source in ("hand", "another") if self.begun and self._rng.random() < 0.1 else ("hand",):
            doubt = self._sources.doubt(source, now_s)
            if doubt is not None:
                gate.doubt(doubt.kind, "a second source of joint states", now_s)


class Contact:
    """Counts protective stops beside a blocked joint, and setpoints that stay beyond its contact after them.

    Beyond is more than the margin that holds links up, and more than the least setpoint since the gate was idle:
    a sensor that has not proved itself calls no setpoint to where none has been.
    """

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._stopped_s: float | None = None
        self._least = np.full(len(limits.names), np.inf)
        self.stops = 0

    def sent(self, setpoint: np.ndarray) -> None:
        """The setpoints (c,) rad in force from now on; NaN where there is none."""
        given = np.isfinite(setpoint)
        self._least = np.where(given, np.minimum(self._least, setpoint), np.inf)

    def audit_sink(self, entry: dict[str, object], now_s: float) -> None:
        """Every decision of the gate."""
        verb = entry["verb"]
        if verb == "trip":
            self._stopped_s = now_s if entry["check"] in PRESSES else None
        elif entry["accepted"]:
            self._stopped_s = now_s if verb == "stop" else None

    def look(self, fault: Fault, setpoint: np.ndarray, now_s: float, heard: bool) -> None:
        """After each turn, with the setpoints (c,) in force; a hand that was not heard meanwhile is no measure."""
        if not heard or fault.wall is None:
            self._stopped_s = None
        if self._stopped_s is None or now_s < self._stopped_s + _LET_GO_S or fault.wall is None:
            return
        self._stopped_s = None
        column = self._limits.names.index(fault.command)
        if np.isfinite(setpoint[column]):
            self.stops += 1
            beyond = float(setpoint[column] - max(fault.wall, self._limits.lower[column]))
            most = float(self._limits.margin[column]) + _EPS_RAD
            all_the_way = setpoint[column] <= self._least[column] + _EPS_RAD
            assert beyond <= most or all_the_way, (
                f"{fault.command} is sent {beyond:.3f} rad beyond its contact after a protective stop"
            )


class Starts:
    """Holds each first command of a motion against all that the hand has said in the last moments."""

    def __init__(self, limits: Limits, tolerance_rad: float, parts: list[list[int]]) -> None:
        self._limits, self._tolerance_rad, self._parts = limits, tolerance_rad, parts
        self._said: list[tuple[float, np.ndarray]] = []
        self.looked_at = 0

    def restarted(self) -> None:
        """A gate that is a new one has not heard what was said before it."""
        self._said = []

    def by_command(self, pose: np.ndarray) -> np.ndarray:
        """(c,) rad of a pose (j,): the sum of each command's joints."""
        return np.array([pose[joints].sum() for joints in self._parts])

    def heard(self, said: np.ndarray, now_s: float) -> None:
        row = self.by_command(said)
        self._said = [one for one in self._said if one[0] >= now_s - RECENT_S] + [(now_s, row)]

    def look(self, fresh: np.ndarray, row: np.ndarray, step: np.ndarray, now_s: float) -> None:
        """`fresh` (c,) bool: commands that had no setpoint before; `step` (c,) rad: as far as one turn goes."""
        if not fresh.any():
            return
        self.looked_at += 1
        for at_s, said in self._said:
            if at_s < now_s - RECENT_S or not np.isfinite(said[fresh]).all():
                continue
            away = np.abs(row - said)[fresh] - self._tolerance_rad - step[fresh]
            assert (away <= _EPS_RAD).all(), "a first command outside of the start tolerance"
