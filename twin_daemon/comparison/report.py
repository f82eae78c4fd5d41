"""A comparison as one plain object, for JSON and tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from twin_daemon.comparison.compare import (
    Comparison,
    compare_recording,
    mean_over_moving,
    noise_floor,
    pooled,
    raw_command_error,
)
from twin_daemon.comparison.region import Region, region_report
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel


def comparison_report(
    twin: TwinModel, recordings: Sequence[Aligned], promoted: TwinModel | None, region: Region | None = None
) -> tuple[dict[str, Any], list[Comparison]]:
    """Compares all recordings with the twin and with the reference predictors; `region` is what it was fitted in."""
    comparisons = [compare_recording(twin, r) for r in recordings]
    joints = pooled(comparisons)
    groups = {
        name: {"mse_rad2": mean_over_moving(joints, members)}
        for name, members in twin.hand.description.groups.items()
        if mean_over_moving(joints, members) is not None
    }
    report = {
        "hand": twin.hand.name,
        "mse_rad2": mean_over_moving(joints),
        "noise_floor_rad2": noise_floor(joints),
        "references": {
            "raw_command": {"mse_rad2": raw_command_error(twin, recordings)},
            "last_promoted": {"mse_rad2": _promoted(promoted, recordings)},
        },
        "groups": groups,
        "joints": joints,
        "region": region_report(twin, region, recordings),
        "recordings": [_one(c) for c in comparisons],
        **_data(comparisons),
    }
    return report, comparisons


def _promoted(promoted: TwinModel | None, recordings: Sequence[Aligned]) -> float | None:
    if promoted is None:
        return None
    return mean_over_moving(pooled([compare_recording(promoted, r) for r in recordings]))


def _one(comparison: Comparison) -> dict[str, Any]:
    recording = comparison.aligned.recording
    return {
        "name": recording.name,
        "path": str(recording.path),
        "sha256": recording.sha256,
        "mse_rad2": mean_over_moving(comparison.joints),
        "onset_s": comparison.aligned.onset_s,
        "onset_estimated": comparison.aligned.onset_free,
        "samples": len(recording.stamp_ns),
    }


def _data(comparisons: Sequence[Comparison]) -> dict[str, Any]:
    qualities = [c.aligned.recording.quality for c in comparisons]
    dropped: dict[str, int] = {}
    for quality in qualities:
        for kind, count in quality.dropped.items():
            dropped[kind] = dropped.get(kind, 0) + count
    rates = [q.rate_hz for q in qualities if q.rate_hz is not None and np.isfinite(q.rate_hz)]
    return {
        "rate_hz": float(np.median(rates)) if rates else None,
        "samples": int(sum(len(c.aligned.recording.stamp_ns) for c in comparisons)),
        "dropped": dropped,
        "onset_s": comparisons[0].aligned.onset_s if comparisons else None,
    }
