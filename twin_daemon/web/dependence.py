"""What the error of the selected joint depends on, beside what the candidates of the last diagnosis predict."""

from __future__ import annotations

from typing import Any

import numpy as np
from starlette.requests import Request
from starlette.routing import BaseRoute

from twin_daemon.comparison.conditions import directions, smooth_speed
from twin_daemon.comparison.dependence import Curve, Plot, dependence, reversals
from twin_daemon.diagnosis.free_rollout import with_finding
from twin_daemon.diagnosis.verdict import Finding
from twin_daemon.errors import BadInput
from twin_daemon.web.app import reading
from twin_daemon.web.jobs import Jobs
from twin_daemon.web.library import Library
from twin_daemon.web.model_cache import ModelCache
from twin_daemon.web.numbers import listed
from twin_daemon.web.queries import lag, onset

_MOST_CANDIDATES = 3
_MOST_TURNS = 200


class Dependence:
    """The question of the panel. Candidates are those that the last diagnosis of the same data found."""

    def __init__(self, library: Library, cache: ModelCache, jobs: Jobs) -> None:
        self._library, self._cache, self._jobs = library, cache, jobs

    @property
    def routes(self) -> list[BaseRoute]:
        return [reading("/api/dependence", self._answer), reading("/api/reversals", self._reversals)]

    def _answer(self, request: Request) -> dict[str, Any]:
        query = request.query_params
        path, joint = self._library.path(query.get("recording", "")), query.get("joint", "")
        version = self._cache.version_id(query.get("version", "nominal"))
        begins, lag_s = onset(request), lag(request)
        found = self._cache.comparison(path, version, begins, lag_s=lag_s)
        if found is None:
            return {"pending": True}
        if joint not in found.joints or not found.joints[joint].moves:
            raise BadInput(f"'{joint}' does not move in this recording")
        column = found.aligned.joints.index(joint)
        others: dict[str, np.ndarray] = {}
        pending = False
        for name in query.getlist("against")[:_MOST_CANDIDATES]:
            other = self._cache.comparison(path, self._cache.version_id(name), begins, lag_s=lag_s)
            pending |= other is None
            if other is not None:
                others[name] = other.predicted[:, column]
        for one in self._candidates(query.get("recording", ""), version):
            other = self._cache.comparison(path, version, begins, with_finding(self._cache.twin(version), one), lag_s)
            pending |= other is None
            if other is not None:
                others[one.name] = other.predicted[:, column]
        plots = dependence(self._cache.twin(version), found, joint, others)
        return {
            "pending": False,
            "curves_pending": pending,
            "joint": joint,
            "plots": [_lists(plot) for plot in plots],
        }

    def _reversals(self, request: Request) -> dict[str, Any]:
        """When a joint turned back (s); of many that many of the first."""
        query = request.query_params
        aligned = self._cache.recording(self._library.path(query.get("recording", "")))
        joint = query.get("joint", "")
        if joint not in aligned.joints:
            raise BadInput(f"no joint '{joint:.60}'", allowed=", ".join(aligned.joints))
        position = aligned.measured[:, aligned.joints.index(joint)]
        turns = reversals(aligned.time_s, directions(smooth_speed(aligned.time_s, position)))
        return {"count": len(turns), "times": listed(turns[:_MOST_TURNS], 4)}

    def _candidates(self, recording: str, version: str) -> list[Finding]:
        job = self._jobs.latest("diagnose")
        if job is None or job.result is None:
            return []
        if (job.about["recording_id"], job.about["version"]) != (recording, version):
            return []
        return [Finding.model_validate(one) for one in job.result["findings"][:_MOST_CANDIDATES]]


def _lists(plot: Plot) -> dict[str, Any]:
    def pairs(curves: dict[str, Curve]) -> dict[str, list[Any]]:
        return {way: [listed(x, 5), listed(y, 3)] for way, (x, y) in curves.items()}

    curves = {name: pairs(one) for name, one in plot.curves.items()}
    return {"name": plot.name, "unit": plot.unit, "points": pairs(plot.points), "curves": curves}
