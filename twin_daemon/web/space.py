"""The hand in space along a recording: where its bodies are as measured, and as a version predicts."""

from __future__ import annotations

import threading

import numpy as np
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute

from twin_daemon.errors import BadInput
from twin_daemon.web.app import reading
from twin_daemon.web.library import Library
from twin_daemon.web.model_cache import ModelCache
from twin_daemon.web.queries import number, onset
from twin_daemon.web.scene import Scene

_MOST_FRAMES = 600


class Space:
    """The questions of the panel."""

    def __init__(self, library: Library, cache: ModelCache) -> None:
        self._library, self._cache = library, cache
        self._lock = threading.Lock()
        self._scene: tuple[str, Scene] | None = None

    @property
    def routes(self) -> list[BaseRoute]:
        return [reading("/api/scene", self._described), reading("/api/poses", self._poses)]

    def _described(self, request: Request) -> dict:
        with self._lock:
            return self._of(self._version(request)).described()

    def _poses(self, request: Request) -> Response:
        """Little-endian float32 (n, 2, b, 7): n moments from `from` to `to` (s), measured and predicted, b bodies with
        place (m) and quaternion; as a header the version's readiness. Without a prediction that is what is measured."""
        query = request.query_params
        path, version = self._library.path(query.get("recording", "")), self._version(request)
        aligned = self._cache.recording(path)
        begin_s, until_s = number(request, "from", 0.0), number(request, "to", float(aligned.time_s[-1]))
        frames = int(number(request, "frames", 1.0))
        if not 1 <= frames <= _MOST_FRAMES:
            raise BadInput(f"{frames} frames", allowed=f"1 to {_MOST_FRAMES}")
        found = self._cache.comparison(path, version, onset(request))
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

    def _version(self, request: Request) -> str:
        return self._cache.version_id(request.query_params.get("version", "nominal"))

    def _of(self, version: str) -> Scene:
        if self._scene is None or self._scene[0] != version:
            self._scene = version, Scene(self._cache.twin(version))
        return self._scene[1]
