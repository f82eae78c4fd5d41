"""How the daemon behaves, and the YAML file that `twin run -c` reads."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from twin_daemon.errors import BadInput, nearest
from twin_daemon.gate.settings import CommandLimit, GateSettings
from twin_daemon.recalibration.settings import RecalibrationSettings


class DaemonSettings(BaseModel):
    """Times and rates of the live twin."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    horizon_s: float = Field(default=2.0, gt=0.0, le=3600.0, description="how long the model runs free between anchors")
    max_catch_up_s: float = Field(default=0.5, gt=0.0, le=10.0, description="a longer gap re-anchors the model")
    stale_after_s: float = Field(default=0.5, gt=0.0, le=60.0, description="data older than this are stale")
    residual_window_s: float = Field(default=10.0, ge=1.0, le=600.0, description="window of the running statistics")
    residual_rate_hz: float = Field(default=50.0, gt=0.0, le=1000.0, description="most residuals published per second")
    drift_false_alarms_per_day: float = Field(
        default=1 / 30, gt=0.0, le=100.0, description="of the drift test, for the whole hand"
    )
    metrics_port: int | None = Field(
        default=None, ge=1, le=65535, description="of the Prometheus endpoint on loopback; none without it"
    )
    health_period_s: float = Field(default=1.0, ge=0.05, le=60.0, description="time between two health messages")
    keep_minutes: float = Field(default=5.0, ge=0.0, le=120.0, description="what 'twin record --keep' can save; 0: off")
    keep_mib: int = Field(default=128, ge=1, le=4096, description="memory for that; the shorter of both counts")
    recordings_quota_mib: int = Field(default=2048, ge=1, description="most that the folder of recordings may hold")
    recordings_rotate: bool = Field(default=False, description="remove the oldest kept recordings to make room")


class RosSettings(BaseModel):
    """A ROS 2 system that is on the same Zenoh network, by its bridge or by its own middleware."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    transport: Literal["ros2dds", "rmw_zenoh"] = Field(description="zenoh-bridge-ros2dds, or the rmw_zenoh middleware")
    domain: int = Field(default=0, ge=0, le=232, description="ROS_DOMAIN_ID, part of the keys of rmw_zenoh")
    joint_states: str = Field(default="joint_states", description="topics by their full names")
    joint_commands: str = "joint_commands"
    twin_joint_states: str = "twin/joint_states"


class AccessSettings(BaseModel):
    """Access control on the network, by the identities of the key file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    anonymous: Literal["look", "nothing"] = Field(default="look", description="what those without an identity may do")


class TwinConfig(BaseModel):
    """The configuration of one daemon. What the command line says wins over the file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    hand: str | None = Field(default=None, description="name in models/ or path of a hand description")
    model: Path | None = Field(default=None, description="an MJCF to use instead of a hand description")
    namespace: str | None = Field(default=None, pattern=r"^[A-Za-z0-9_\-]+(/[A-Za-z0-9_\-]+)*$")
    version: str | None = Field(default=None, description="id of a stored version; default: the promoted one")
    endpoint: str | None = Field(default=None, description="Zenoh endpoint, such as tcp/127.0.0.1:7447")
    ros: RosSettings | None = Field(default=None, description="a ROS 2 system on the same Zenoh network")
    access: AccessSettings | None = Field(default=None, description="access control; none without it")
    daemon: DaemonSettings = DaemonSettings()
    gate: GateSettings = GateSettings()
    recalibration: RecalibrationSettings = RecalibrationSettings()


def load_config(path: Path) -> TwinConfig:
    """Reads a daemon configuration. Raises BadInput that names the key and what is allowed there."""
    try:
        raw = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise BadInput(f"cannot be read: {error}", where=path, todo="Give a YAML file") from None
    try:
        config = TwinConfig.model_validate({} if raw is None else raw)
    except ValidationError as error:
        raise _explain(path, error) from None
    return _relative_to(path.parent, config)


def _relative_to(folder: Path, config: TwinConfig) -> TwinConfig:
    """Paths in the file are relative to the file, not to wherever the daemon was started."""
    changes: dict[str, object] = {}
    if config.model is not None and not config.model.is_absolute():
        changes["model"] = folder / config.model
    if config.hand is not None and config.hand.endswith((".yaml", ".yml")) and not Path(config.hand).is_absolute():
        changes["hand"] = str(folder / config.hand)
    return config.model_copy(update=changes)


def _explain(path: Path, error: ValidationError) -> BadInput:
    first = error.errors()[0]
    location = [str(part) for part in first["loc"]]
    key = ".".join(location) or "(top)"
    if first["type"] == "extra_forbidden":
        sections = {
            "daemon": DaemonSettings,
            "ros": RosSettings,
            "gate": GateSettings,
            "access": AccessSettings,
            "recalibration": RecalibrationSettings,
        }
        section = CommandLimit if location[:2] == ["gate", "limits"] else TwinConfig
        known = sections.get(".".join(location[:-1]), section).model_fields
        return BadInput(f"unknown key '{key}'", where=path, allowed=", ".join(known), todo=nearest(location[-1], known))
    return BadInput(f"{key}: {first['msg']} (got {first['input']!r:.60})", where=path, todo="Correct this key")
