"""How the daemon behaves: every key of its configuration, with its unit, its bounds and what it means.

`docs/configuration.md` is made of this file. A key with LIVE is taken over while the daemon runs.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from twin_daemon.gate.settings import GateSettings
from twin_daemon.hand import NAMESPACE
from twin_daemon.recalibration.settings import RecalibrationSettings

LIVE: dict[str, Any] = {"live": True}


class DaemonSettings(BaseModel):
    """Times and rates of the live twin."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    horizon_s: float = Field(
        default=2.0,
        gt=0.0,
        le=3600.0,
        description="how long the model runs free before it is set to the measured state again",
        json_schema_extra=LIVE,
    )
    max_catch_up_s: float = Field(
        default=0.5,
        gt=0.0,
        le=10.0,
        description="after a longer gap the model is set to the measured state",
        json_schema_extra=LIVE,
    )
    stale_after_s: float = Field(
        default=0.5, gt=0.0, le=60.0, description="data older than this are stale", json_schema_extra=LIVE
    )
    residual_window_s: float = Field(default=10.0, ge=1.0, le=600.0, description="window of the running statistics")
    residual_rate_hz: float = Field(
        default=50.0,
        gt=0.0,
        le=1000.0,
        description="most residuals published per second",
        json_schema_extra=LIVE,
    )
    drift_false_alarms_per_day: float = Field(
        default=1 / 30, gt=0.0, le=100.0, description="of the drift test, for the whole hand"
    )
    name_changes: bool = Field(
        default=True,
        description="once a joint drifts, diagnose what has changed since the version in use",
        json_schema_extra=LIVE,
    )
    name_changes_seconds: float = Field(
        default=150.0, gt=0.0, le=3600.0, description="what such a diagnosis may take", json_schema_extra=LIVE
    )
    metrics_port: int | None = Field(
        default=None, ge=1, le=65535, description="of the Prometheus endpoint on loopback; none without it"
    )
    health_period_s: float = Field(
        default=1.0, ge=0.05, le=60.0, description="time between two health messages", json_schema_extra=LIVE
    )
    keep_minutes: float = Field(default=5.0, ge=0.0, le=120.0, description="what 'twin record --keep' can save; 0: off")
    keep_mib: int = Field(default=128, ge=1, le=4096, description="memory for that; the shorter of both counts")
    recordings_quota_mib: int = Field(
        default=2048, ge=1, description="most that the folder of recordings may hold", json_schema_extra=LIVE
    )
    recordings_rotate: bool = Field(
        default=False, description="remove the oldest kept recordings to make room", json_schema_extra=LIVE
    )


class RosSettings(BaseModel):
    """A ROS 2 system that is on the same Zenoh network, by its bridge or by its own middleware."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    transport: Literal["ros2dds", "rmw_zenoh"] = Field(description="zenoh-bridge-ros2dds, or the rmw_zenoh middleware")
    domain: int = Field(default=0, ge=0, le=232, description="ROS_DOMAIN_ID, part of the keys of rmw_zenoh")
    joint_states: str = Field(default="joint_states", description="topic of the measured joints, by its full name")
    joint_commands: str = Field(default="joint_commands", description="topic of the position targets")
    twin_joint_states: str = Field(default="twin/joint_states", description="topic of the prediction")


class AccessSettings(BaseModel):
    """Access control on the network, by the identities of the key file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    anonymous: Literal["look", "nothing"] = Field(default="look", description="what those without an identity may do")
    certificates: bool = Field(
        default=False,
        description="true: nobody joins without a certificate of `twin security init`; the endpoint is then a tls/ one",
    )


class TwinConfig(BaseModel):
    """The configuration of one daemon."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    hand: str | None = Field(
        default=None, description="name in models/ or path of a hand description; the Shadow Hand without it"
    )
    model: Path | None = Field(default=None, description="an MJCF to use instead of a hand description")
    namespace: str | None = Field(
        default=None,
        pattern=NAMESPACE,
        description="first part of the keys on the network; the hand's own without it",
    )
    version: str | None = Field(default=None, description="id of a stored version; the promoted one without it")
    endpoint: str | None = Field(default=None, description="Zenoh endpoint; tcp/127.0.0.1:7447 without it")
    daemon: DaemonSettings = Field(default=DaemonSettings(), description="times and rates of the live twin")
    gate: GateSettings = Field(default=GateSettings(), description="commands to the hand: docs/safety.md")
    ros: RosSettings | None = Field(default=None, description="a ROS 2 system on the same Zenoh network; none without")
    access: AccessSettings | None = Field(default=None, description="access control; none without it")
    recalibration: RecalibrationSettings = Field(
        default=RecalibrationSettings(), description="when the twin is fitted anew, and what may be promoted"
    )
