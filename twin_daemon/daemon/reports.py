"""What the live twin answers: JSON objects with "schema": 1. Unknown numbers are null."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from twin_daemon.daemon.extrapolation import outside_in_words
from twin_daemon.daemon.messages import number
from twin_daemon.versions.version import promised_rad2

if TYPE_CHECKING:
    from twin_daemon.daemon.service import TwinService


def header(service: TwinService) -> dict[str, Any]:
    """What every answer begins with."""
    return {"schema": 1, "hand": service.hand.description.name, "namespace": service.namespace}


def live_status(service: TwinService) -> str:
    """`waiting` (nothing heard yet), `stale`, `no_commands` (the model holds the pose) or `following`."""
    state = service.predictor.state
    if state == "waiting" or not np.isfinite(service.mirror.position).any():
        return "waiting"
    return "stale" if service.stale else state


def state(service: TwinService) -> dict[str, Any]:
    """Each joint measured and predicted, with its own stamp, age and freshness."""
    mirror = service.mirror
    ages = mirror.ages_s(service.monotonic_s())
    stale = ages > service.settings.stale_after_s
    known = np.isfinite(mirror.position)
    joints = {
        name: {
            "measured_rad": number(mirror.position[i]),
            "predicted_rad": number(service.predicted[i]),
            "residual_rad": number(service.residuals.last_rad[i]),
            "velocity_rad_s": number(mirror.velocity[i]) if known[i] else None,
            "stamp_ns": int(mirror.stamp_ns[i]) if known[i] else None,
            "age_s": number(ages[i]),
            "stale": bool(stale[i]),
        }
        for i, name in enumerate(mirror.joints)
    }
    return header(service) | {
        "status": live_status(service),
        "version": service.version_info["id"],
        "stamp_ns": service.stamp_ns,
        "age_s": number(service.age_s),
        "stale": service.stale,
        "fresh_joints": int((~stale).sum()),
        "joints": joints,
        "region": service.extrapolation.at(mirror.position, mirror.velocity),
        "commands": _commands(service),
        "prediction": _prediction(service),
        "gate": service.gate(),
        "mirror": service.kinematics.at(mirror.position),
    }


def residual_now(service: TwinService) -> dict[str, Any]:
    """The small object that is published beside the predictions: the residual of one sample."""
    last = service.residuals.last_rad
    return {
        "schema": 1,
        "stamp_ns": service.stamp_ns,
        "status": live_status(service),
        "version": service.version_info["id"],
        "anchored_ns": service.predictor.anchored_ns,
        "residual_rad": {name: number(last[i]) for i, name in enumerate(service.joints)},
    }


def residual(service: TwinService) -> dict[str, Any]:
    """Statistics of measured minus predicted over the window."""
    statistics = service.residuals.statistics()
    seen = statistics.samples > 0
    mean = float(statistics.mse_rad2[seen].mean()) if seen.any() else float("nan")
    joints = {
        name: {
            "residual_rad": number(service.residuals.last_rad[i]),
            "bias_rad": number(statistics.bias_rad[i]),
            "rmse_rad": number(statistics.rmse_rad[i]),
            "mse_rad2": number(statistics.mse_rad2[i]),
            "max_abs_rad": number(statistics.max_abs_rad[i]),
            "samples": int(statistics.samples[i]),
        }
        for i, name in enumerate(service.joints)
    }
    return header(service) | {
        "status": live_status(service),
        "version": service.version_info["id"],
        "stamp_ns": service.stamp_ns,
        "window_s": service.settings.residual_window_s,
        "mse_rad2": number(mean),
        "promoted_mse_rad2": promised_rad2(service.version_info.get("errors")),
        "joints": joints,
        "prediction": _prediction(service),
    }


def health(service: TwinService) -> dict[str, Any]:
    """Whether the twin does its work, and everything it refused, by kind."""
    intake = service.intake
    refused = dict(sorted(intake.counts.items()))
    return header(service) | {
        "status": live_status(service),
        "pid": os.getpid(),
        "uptime_s": service.monotonic_s() - service.started_s,
        "version": service.version_info["id"],
        "age_s": number(service.age_s),
        "stale": service.stale,
        "joint_states": {
            "received": intake.received,
            "accepted": intake.accepted,
            "counts": refused,
            "unknown_names": sorted(intake.unknown_names),
        },
        "joint_commands": {
            "received": service.commands_received,
            "counts": dict(sorted(service.command_counts.items())),
        },
        "prediction": _prediction(service) | {
            "steps": service.predictor.steps,
            "anchors": dict(sorted(service.predictor.anchors.items())),
        },
        "changed": list(service.changed),
        "outside": outside_in_words(service.extrapolation.at(service.mirror.position, service.mirror.velocity)),
        "loop": service.loop,
        "timing": service.timing.as_json(),
        "gate": None if (gate := service.gate()) is None else gate["mode"],
        "events": service.events.recent(10),
    }  # fmt: skip


def _commands(service: TwinService) -> dict[str, Any]:
    arrival_s = service.command_arrival_s
    return {
        "received": service.commands_received,
        "age_s": None if arrival_s is None else service.monotonic_s() - arrival_s,
        "targets_rad": service.predictor.targets_rad,
    }


def _prediction(service: TwinService) -> dict[str, Any]:
    predictor = service.predictor
    return {
        "state": predictor.state,
        "horizon_s": service.settings.horizon_s,
        "anchored_ns": predictor.anchored_ns,
        "anchor_reason": predictor.anchor_reason,
    }
