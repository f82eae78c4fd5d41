"""What a site sets about the gate."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

LONGEST_LEASE_S = 3600.0
_LONGEST_SILENCE_S = 5.0


class CommandLimit(BaseModel):
    """Limits of one command. Those of the model and of the hand's description hold as well: the tightest counts."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    lower_rad: float | None = Field(default=None, description="least target")
    upper_rad: float | None = Field(default=None, description="greatest target")
    velocity_rad_s: float | None = Field(default=None, gt=0.0, description="fastest change of the target")
    acceleration_rad_s2: float | None = Field(default=None, gt=0.0, description="fastest change of that velocity")
    step_rad: float | None = Field(default=None, gt=0.0, description="farthest from one command to the next")
    lower_m: float | None = Field(default=None, description="the same five of what slides")
    upper_m: float | None = Field(default=None, description="greatest target")
    velocity_m_s: float | None = Field(default=None, gt=0.0, description="fastest change of the target")
    acceleration_m_s2: float | None = Field(default=None, gt=0.0, description="fastest change of that velocity")
    step_m: float | None = Field(default=None, gt=0.0, description="farthest from one command to the next")

    @model_validator(mode="after")
    def _in_order(self) -> CommandLimit:
        for low, high, unit in ((self.lower_rad, self.upper_rad, "rad"), (self.lower_m, self.upper_m, "m")):
            if low is not None and high is not None and low >= high:
                raise ValueError(f"lower_{unit} {low:g} is not below upper_{unit} {high:g}")
        return self


class TrackingLimit(BaseModel):
    """How far one command may be from its target beyond what the twin predicts, and for how long."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    floor_rad: float | None = Field(default=None, ge=0.0, description="in place of gate.tracking_floor_rad")
    time_s: float | None = Field(default=None, ge=0.0, le=10.0, description="in place of gate.tracking_time_s")


class GateSettings(BaseModel):
    """Times and limits of the gate, and what ends a motion."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    rate_hz: float = Field(default=125.0, ge=20.0, le=1000.0, description="commands a second while something moves")
    lease_s: float = Field(default=60.0, gt=0.0, le=LONGEST_LEASE_S, description="of an arming that names none")
    heartbeat_s: float = Field(
        default=1.0,
        ge=0.05,
        le=10.0,
        description="a motion is held when its commander is silent for so long, or "
        "for seven times as long as is usual with him",
    )
    state_timeout_s: float = Field(
        default=0.07,
        ge=0.02,
        le=_LONGEST_SILENCE_S,
        description="a motion is held when the hand or the daemon is silent for so long, or the gate stood still; of a "
        "hand slower than 125 Hz nine of its periods",
    )
    command_age_s: float = Field(default=2.0, gt=0.0, le=60.0, description="an older request is refused")
    speed: float = Field(default=1.0, gt=0.0, le=1.0, description="share of the velocity limits that may be used")
    move_speed: float = Field(default=0.25, gt=0.0, le=1.0, description="the same for a move that names no time")
    jump_rad: float = Field(
        default=0.3, gt=0.0, description="farthest of a streamed target from where the hand is sent"
    )
    implausible_speed: float = Field(
        default=3.0,
        ge=1.0,
        le=100.0,
        description="no reading changes faster than so many velocity limits",
    )
    start_tolerance_rad: float = Field(
        default=0.15, gt=0.0, description="farthest of a first command from every state of the last 0.1 s"
    )
    tracking_ratio: float = Field(
        default=3.0,
        ge=1.0,
        le=100.0,
        description="farthest of the hand from its target, in lags of the twin",
    )
    tracking_floor_rad: float = Field(
        default=0.05, ge=0.0, description="so much farther is allowed, beside noise and resolution of the sensors"
    )
    tracking_error_rad: float = Field(
        default=0.5, gt=0.0, description="farthest of the hand from its target, whatever the twin predicts"
    )
    tracking_time_s: float = Field(
        default=0.1, ge=0.0, le=10.0, description="farther than allowed for longer than this ends the motion"
    )
    tracking: dict[str, TrackingLimit] = Field(default_factory=dict, description="by command")
    after_trip: Literal["let_go", "hold"] = Field(
        default="let_go",
        description="let_go: the targets go back to where the hand is; hold: they stay, and a grasp holds",
    )
    effort_limit: dict[str, float] = Field(default_factory=dict, description="by joint, in the driver's unit")
    collision_depth_m: float = Field(
        default=0.001, ge=0.0, le=0.05, description="deepest overlap of two bodies of the hand that is not refused"
    )
    limits: dict[str, CommandLimit] = Field(default_factory=dict, description="by command")

    def for_rate(self, rate_hz: float) -> GateSettings:
        """The same for a hand that speaks so often: where no `state_timeout_s` is given, one slower than 125 Hz may be
        silent for nine of its periods."""
        if "state_timeout_s" in self.model_fields_set:
            return self
        longest_s = min(max(self.state_timeout_s, 9.0 / rate_hz), _LONGEST_SILENCE_S)
        return self.model_copy(update={"state_timeout_s": longest_s})
