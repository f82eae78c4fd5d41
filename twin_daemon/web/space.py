"""The hand in space along a recording: where its bodies are as measured, and as a version predicts."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute

from twin_daemon.comparison.compare import Comparison
from twin_daemon.errors import BadInput
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.web.app import reading
from twin_daemon.web.library import Library
from twin_daemon.web.model_cache import ModelCache
from twin_daemon.web.numbers import listed
from twin_daemon.web.queries import lag, number, onset
from twin_daemon.web.scene import Scene

_MOST_FRAMES = 600
_PATH_POINTS = 240


class Space:
    """The questions of the panel."""

    def __init__(self, library: Library, cache: ModelCache) -> None:
        self._library, self._cache = library, cache
        self._lock = threading.Lock()
        self._scene: tuple[str, Scene] | None = None

    @property
    def routes(self) -> list[BaseRoute]:
        return [
            reading("/api/scene", self._described),
            reading("/api/poses", self._poses),
            reading("/api/path", self._path),
            reading("/api/contacts", self._contacts),
        ]

    def _described(self, request: Request) -> dict:
        with self._lock:
            return self._of(self._version(request)).described()

    def _poses(self, request: Request) -> Response:
        """Little-endian float32 (n, 2, b, 7): n moments from `from` to `to` (s), measured and predicted, b bodies with
        place (m) and quaternion; as a header the version's readiness. Without a prediction that is what is measured."""
        aligned, found, version = self._asked(request)
        begin_s, until_s = number(request, "from", 0.0), number(request, "to", float(aligned.time_s[-1]))
        frames = int(number(request, "frames", 1.0))
        if not 1 <= frames <= _MOST_FRAMES:
            raise BadInput(f"{frames} frames", allowed=f"1 to {_MOST_FRAMES}")
        moments = np.clip(np.linspace(begin_s, until_s, frames), 0.0, float(aligned.time_s[-1]))
        index = np.clip(np.searchsorted(aligned.time_s, moments), 0, len(aligned.time_s) - 1)
        with self._lock:
            scene = self._of(version)
            out = np.empty((frames, 2, len(scene.joints), 7), "<f4")
            for row, at in enumerate(index):
                out[row, 0] = scene.poses(aligned.measured[at])
                out[row, 1] = out[row, 0] if found is None else scene.poses(found.predicted[at])
        headers = {"X-Predicted": "no" if found is None else "yes", "X-Bodies": str(len(scene.joints))}
        return Response(out.tobytes(), media_type="application/octet-stream", headers=headers)

    def _path(self, request: Request) -> dict[str, Any]:
        """Where the tip of what a joint moves is from `from` to `to` (s): points (n, 3) m, measured and predicted."""
        aligned, found, version = self._asked(request)
        joint = request.query_params.get("joint", "")
        end_s = float(aligned.time_s[-1])
        moments = np.linspace(number(request, "from", 0.0), number(request, "to", end_s), _PATH_POINTS)
        index = np.unique(np.clip(np.searchsorted(aligned.time_s, moments), 0, len(aligned.time_s) - 1))
        with self._lock:
            scene = self._of(version)
            if joint not in scene.tips:
                raise BadInput(f"no joint '{joint:.60}'", allowed=", ".join(scene.tips))

            def tips(readings: np.ndarray) -> list[Any]:
                return listed(np.array([scene.tip(joint, scene.poses(row)) for row in readings[index]]), 5)

            predicted = None if found is None else tips(found.predicted)
            return {"measured": tips(aligned.measured), "predicted": predicted, "pending": found is None}

    def _contacts(self, request: Request) -> dict[str, Any]:
        """Where the measured and the predicted hand touch something at `at` (s): points (k, 4) m with their distance,
        by the model's own geometry."""
        aligned, found, version = self._asked(request)
        at = np.searchsorted(aligned.time_s, number(request, "at", 0.0))
        row = int(np.clip(at, 0, len(aligned.time_s) - 1))
        with self._lock:
            scene = self._of(version)
            predicted = None if found is None else listed(scene.contacts(found.predicted[row]), 5)
            return {"measured": listed(scene.contacts(aligned.measured[row]), 5), "predicted": predicted}

    def _asked(self, request: Request) -> tuple[Aligned, Comparison | None, str]:
        path, version = self._library.path(request.query_params.get("recording", "")), self._version(request)
        found = self._cache.comparison(path, version, onset(request), lag_s=lag(request))
        return self._cache.recording(path), found, version

    def _version(self, request: Request) -> str:
        return self._cache.version_id(request.query_params.get("version", "nominal"))

    def _of(self, version: str) -> Scene:
        if self._scene is None or self._scene[0] != version:
            self._scene = version, Scene(self._cache.twin(version))
        return self._scene[1]
