"""Recordings against versions: curves for the range that is on the screen, errors, and where the twin fails."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from starlette.requests import Request
from starlette.routing import BaseRoute

from twin_daemon.comparison.compare import common_lag, mean_over_moving, noise_floor
from twin_daemon.comparison.conditions import CONDITIONS, errors_by_condition
from twin_daemon.errors import BadInput
from twin_daemon.figures.reduce import keep_extremes
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.versions import NOMINAL
from twin_daemon.web.app import reading
from twin_daemon.web.curves import Shape, drawn, spectrum
from twin_daemon.web.library import Library
from twin_daemon.web.model_cache import ModelCache
from twin_daemon.web.numbers import listed
from twin_daemon.web.queries import lag, number, onset

BUCKETS = 400
"""Stretches that a chart is drawn from; of each the lowest and highest sample of every curve is kept."""

_MOST_VERSIONS = 3
_MOST_JOINTS = 64
_WORST = 8
_FEWEST = 16  # samples of a spectrum
_SPARKS = 60  # stretches of a sparkline
_TIMELINE = 600
_DIGITS = 6  # micro-radians


class Compare:
    """The questions of the view; `routes` are their paths."""

    def __init__(self, library: Library, cache: ModelCache) -> None:
        self._library, self._cache = library, cache

    @property
    def routes(self) -> list[BaseRoute]:
        return [
            reading("/api/recordings", lambda _: {"recordings": self._library.offers()}),
            reading("/api/recording", self._opened),
            reading("/api/window", self._window),
            reading("/api/spectrum", self._spectrum),
            reading("/api/align", self._align),
            reading("/api/errors", self._errors),
            reading("/api/overview", self._overview),
        ]

    def _opened(self, request: Request) -> dict[str, Any]:
        path = self._path(request)
        aligned, moving = self._cache.recording(path), self._cache.moving(path)
        return {
            "name": aligned.recording.name,
            "begin_s": float(aligned.recording.stamp_ns[0]) * 1e-9,
            "samples": len(aligned.time_s),
            "seconds": float(aligned.time_s[-1]),
            "rate_hz": aligned.recording.quality.rate_hz,
            "commands_recorded": not aligned.onset_free,
            "notes": aligned.recording.quality.notes,
            "joints": [{"name": name, "moves": bool(moving[i])} for i, name in enumerate(aligned.joints)],
        }

    def _window(self, request: Request) -> dict[str, Any]:
        """Curves of some joints over a range of time: every sample, or fewer where there are more than a chart shows.

        `lag_ms` moves what the twins predict to later times; `quantity`, `derivative` and `lowpass_hz` say what of it.
        """
        path, versions = self._path(request), self._versions(request)
        aligned = self._cache.recording(path)
        joints = request.query_params.getlist("joint")
        unknown = [name for name in joints if name not in aligned.joints]
        if unknown or len(joints) > _MOST_JOINTS:
            raise BadInput(f"no joint '{(unknown or joints)[0]}'", allowed=", ".join(aligned.joints))
        end_s = float(aligned.time_s[-1])
        begin_s, until_s = number(request, "from", 0.0), number(request, "to", end_s)
        shape = Shape.of(request)
        onset_s, lag_s = onset(request), lag(request)
        comparisons = {version: self._cache.comparison(path, version, onset_s, lag_s=lag_s) for version in versions}
        twins = {v: (self._cache.twin(v), found) for v, found in comparisons.items() if found is not None}
        first, last = np.searchsorted(aligned.time_s, [begin_s, until_s], side="left")
        # one sample beyond either end, so that the lines leave the chart
        chosen = slice(max(int(first) - 1, 0), min(int(last) + 2, len(aligned.time_s)))
        curves, samples = {}, len(aligned.time_s[chosen])
        for name in joints:
            column = aligned.joints.index(name)
            told = partial(self._command, aligned, column)
            curve = drawn(shape, aligned, column, chosen, None if shape.plain else told, twins)
            columns = [curve.measured, *curve.twins.values(), *(curve.measured - twin for twin in curve.twins.values())]
            kept = keep_extremes(np.column_stack(columns), BUCKETS)
            at_s = aligned.time_s[chosen][kept]
            curves[name] = {
                "t": np.round(at_s, 6),
                "measured": listed(curve.measured[kept], _DIGITS),
                # where nothing is filtered, only what is drawn: all of ten minutes takes a second
                "command": listed(told(at_s) if shape.plain else curve.command[kept], _DIGITS),
                "twins": {version: listed(twin[kept], _DIGITS) for version, twin in curve.twins.items()},
                "kept": len(kept),
            }
        return {
            "from": begin_s,
            "to": until_s,
            "samples": samples,
            "unit": shape.unit,
            "exact": all(curve["kept"] == samples for curve in curves.values()),
            "curves": curves,
            "pending": [version for version, found in comparisons.items() if found is None],
        }

    def _spectrum(self, request: Request) -> dict[str, Any]:
        """What of a joint is at which frequency, over a range of time: measured, commanded, predicted, residual."""
        path, versions = self._path(request), self._versions(request)
        aligned = self._cache.recording(path)
        name = request.query_params.get("joint", "")
        if name not in aligned.joints:
            raise BadInput(f"no joint '{name:.60}'", allowed=", ".join(aligned.joints))
        begin_s, until_s = number(request, "from", 0.0), number(request, "to", float(aligned.time_s[-1]))
        first, last = np.searchsorted(aligned.time_s, [begin_s, until_s], side="left")
        if last - first < _FEWEST:
            raise BadInput(f"{last - first} samples have no spectrum", allowed=f"{_FEWEST} or more", todo="Zoom out")
        found = {v: self._cache.comparison(path, v, onset(request), lag_s=lag(request)) for v in versions}
        twins = {v: (self._cache.twin(v), one) for v, one in found.items() if one is not None}
        shape, column = Shape.of(request), aligned.joints.index(name)
        curve = drawn(
            shape, aligned, column, slice(int(first), int(last)), partial(self._command, aligned, column), twins
        )
        rate_hz = 1.0 / float(np.median(np.diff(aligned.time_s)))
        frequency, measured = spectrum(curve.measured, rate_hz)
        told = np.isfinite(curve.command).any()

        def density(values: np.ndarray) -> list[Any]:
            return listed(spectrum(values, rate_hz)[1], 9)

        return {
            "unit": shape.unit,
            "f": listed(frequency, 4),
            "measured": listed(measured, 9),
            "command": density(curve.command) if told else [None] * len(frequency),
            "twins": {version: density(twin) for version, twin in curve.twins.items()},
            "residuals": {version: density(curve.measured - twin) for version, twin in curve.twins.items()},
            "pending": [version for version, one in found.items() if one is None],
        }

    def _align(self, request: Request) -> dict[str, Any]:
        """The shift of the prediction that suits all joints best, beside what is shifted already."""
        path = self._path(request)
        (version,) = self._versions(request)[:1]
        found = self._cache.comparison(path, version, onset(request))
        if found is None:
            return {"pending": True}
        best = common_lag(found)
        if best is None:
            raise BadInput("no joint tells by how much the prediction comes early or late", todo="Show more motion")
        return {"pending": False, "lag_ms": round(1e3 * best, 2)}

    def _command(self, aligned: Aligned, column: int, time_s: np.ndarray) -> np.ndarray:
        """(k,) rad: where the joint was told to be; a tendon's angle in equal parts. NaN where no command drives it."""
        drive = self._cache.nominal.drive
        if not drive[:, column].any():
            return np.full(len(time_s), np.nan)
        return aligned.controls(self._cache.nominal, time_s) @ np.linalg.pinv(drive)[column]

    def _errors(self, request: Request) -> dict[str, Any]:
        """Errors by joint, and by condition with the worst first; `pending` while the twin is being rolled out."""
        path = self._path(request)
        (version,) = self._versions(request)[:1]
        found = self._cache.comparison(path, version, onset(request), lag_s=lag(request))
        if found is None:
            return {"pending": True}
        moving = {name: error for name, error in found.joints.items() if error.moves}
        conditions = errors_by_condition([(found.aligned, found.predicted)])
        return {
            "pending": False,
            "version": version,
            "mse_rad2": mean_over_moving(found.joints),
            "noise_floor_rad2": noise_floor(found.joints),
            "still": len(found.joints) - len(moving),
            "onset_s": found.aligned.onset_s,
            "onset_estimated": found.aligned.onset_free,
            "joints": dict(sorted(moving.items(), key=lambda item: -item[1].mse_rad2)),
            "conditions": conditions,
            "condition_names": CONDITIONS,
        }

    def _overview(self, request: Request) -> dict[str, Any]:
        """The residual at a glance: of each moving joint its largest in each of some stretches (mrad, with its sign),
        of all of them the root mean square over time, and the moments that are worth a look; worst joints first."""
        path = self._path(request)
        (version,) = self._versions(request)[:1]
        found = self._cache.comparison(path, version, onset(request), lag_s=lag(request))
        if found is None:
            return {"pending": True}
        moving = [(i, name) for i, name in enumerate(found.aligned.joints) if found.aligned.moving[i]]
        moving.sort(key=lambda one: -found.joints[one[1]].mse_rad2)
        residual = np.nan_to_num(found.residual)
        columns = residual[:, [i for i, _ in moving]]
        rms = np.sqrt(np.mean(columns**2, axis=1)) if moving else np.zeros(len(residual))
        conditions = errors_by_condition([(found.aligned, found.predicted)])
        return {
            "pending": False,
            "seconds": float(found.aligned.time_s[-1]),
            "joints": [
                {"name": name, "rmse_rad": found.joints[name].rmse_rad, "spark": _peaks(residual[:, i], _SPARKS)}
                for i, name in moving
            ],
            "rms_mrad": _peaks(rms, _TIMELINE),
            "worst": [
                {"joint": one.joint, "condition": one.condition, "time_s": one.worst_s} for one in conditions[:_WORST]
            ],
        }

    def _path(self, request: Request) -> Path:
        return self._library.path(request.query_params.get("recording", ""))

    def _versions(self, request: Request) -> list[str]:
        given = request.query_params.getlist("version") or [NOMINAL]
        if len(given) > _MOST_VERSIONS:
            raise BadInput(f"{len(given)} versions at once", allowed=f"at most {_MOST_VERSIONS}")
        return list(dict.fromkeys(self._cache.version_id(reference) for reference in given))


def _peaks(values: np.ndarray, buckets: int) -> list[Any]:
    """Of each of so many stretches of (n,) rad the value farthest from zero, in mrad."""
    parts = np.array_split(1e3 * values, min(buckets, len(values)))
    return listed(np.array([part[np.argmax(np.abs(part))] for part in parts]), 3)
