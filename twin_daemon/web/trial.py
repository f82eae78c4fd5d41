"""An effect by hand: what one finger would do with values that somebody drags, over the stretch on the screen."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from starlette.requests import Request
from starlette.routing import BaseRoute

from twin_daemon.comparison.compare import Comparison
from twin_daemon.effects import LIBRARY
from twin_daemon.effects.base import Effect, Place
from twin_daemon.errors import BadInput, nearest
from twin_daemon.estimation.partition import restricted
from twin_daemon.estimation.windows import stretch
from twin_daemon.places import HAND, ROBOT
from twin_daemon.simulation.alignment import Aligned, predict
from twin_daemon.simulation.submodel import parts, submodel, with_coupled
from twin_daemon.simulation.terms import EffectTerm
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.web.app import reading
from twin_daemon.web.library import Library
from twin_daemon.web.model_cache import ModelCache
from twin_daemon.web.numbers import listed
from twin_daemon.web.queries import number, onset

LONGEST_S = 10.0
"""Of a view that shows more, so much from its beginning is predicted: a hand on a slider waits for no more."""

_RUN_IN_S = 1.0  # before the view, in which what remembers finds its state
_MOST_POINTS = 1500
_MOST_FINGERS = 4


@dataclass(frozen=True)
class _Finger:
    """One part of the hand on its own: its model without geoms, and the recording `found` cut to its joints."""

    found: Comparison
    twin: TwinModel
    aligned: Aligned


@dataclass(frozen=True)
class _Excerpt:
    """A stretch of a recording, and what the finger does in it without the effect: (n, j) rad."""

    finger: _Finger
    span: tuple[float, float]
    aligned: Aligned
    begin_s: float
    without: np.ndarray


class Trial:
    """The questions of the sliders. The finger and the stretch that were asked for last stay compiled and at hand."""

    def __init__(self, library: Library, cache: ModelCache) -> None:
        self._library, self._cache = library, cache
        self._lock = threading.Lock()
        self._fingers: dict[tuple[str, str, str], _Finger] = {}
        self._excerpt: _Excerpt | None = None

    @property
    def routes(self) -> list[BaseRoute]:
        return [reading("/api/trial/values", self._values), reading("/api/trial", self._predicted)]

    def _values(self, request: Request) -> dict[str, Any]:
        """The sliders of an effect at a place: where each value may lie, and where it begins."""
        version = self._cache.version_id(request.query_params.get("version", "nominal"))
        twin = self._cache.twin(version)
        effect, place = _effect(request), twin.place(request.query_params.get("place", ""))
        require_fit(effect, place)
        scale = twin.scale(twin.actuators[0] if place.target in (HAND, ROBOT) else place.target)
        present = next(
            (t.values for t in twin.terms.effects if (t.effect, t.target) == (effect.key, place.target)), None
        )
        starts = effect.starts(scale)
        begin = effect.complete(present or starts[len(starts) // 2])
        bounds = effect.bounds(scale)
        return {
            "present": present is not None,
            "parameters": [
                {
                    "name": one.name, "unit": one.unit, "meaning": one.meaning, "log": one.log, "neutral": one.neutral,
                    "lower": bounds[one.name][0], "upper": bounds[one.name][1], "value": begin[one.name],
                }
                for one in effect.parameters
                if bounds[one.name][0] < bounds[one.name][1]
            ],
        }  # fmt: skip

    def _predicted(self, request: Request) -> dict[str, Any]:
        """What the finger of a joint does with an effect at given values: `value` is NAME:NUMBER, once for each.

        It starts where the joints were measured a little before the view, so that its errors are those of the stretch
        and not those of the whole recording; and nothing touches anything.
        """
        began = time.perf_counter()
        query = request.query_params
        path, joint = self._library.path(query.get("recording", "")), query.get("joint", "")
        version, begins = self._cache.version_id(query.get("version", "nominal")), onset(request)
        effect = _effect(request)
        found = self._cache.comparison(path, version, begins)
        if found is None:
            return {"pending": True}
        from_s = number(request, "from", 0.0)
        until_s = min(number(request, "to", float(found.aligned.time_s[-1])), from_s + LONGEST_S)
        with self._lock:
            excerpt = self._cut(self._finger(str(path), version, joint, found), from_s, until_s)
            finger = excerpt.finger
            place = self._cache.twin(version).place(query.get("place", ""))
            require_fit(effect, place)
            if place.target not in (HAND, ROBOT, *finger.twin.joints, *finger.twin.actuators):
                raise BadInput(f"{place.target} is no part of the finger of {joint}", todo="Choose a joint of it")
            term = EffectTerm(effect=effect.key, target=place.target, values=effect.complete(_given(request)))
            changed = finger.twin.changed(finger.twin.terms.with_effect(term))
            predicted = predict(changed, excerpt.aligned, threads=1)
        time_s = excerpt.aligned.time_s + excerpt.begin_s
        shown = np.flatnonzero((time_s >= from_s) & (time_s <= until_s))
        every = shown[:: max(len(shown) // _MOST_POINTS, 1)]
        column = finger.twin.joints.index(joint)
        measured = excerpt.aligned.states[shown, column]
        return {
            "pending": False,
            "from": from_s,
            "to": until_s,
            "t": listed(time_s[every], 5),
            "curves": {name: listed(predicted[every, i], 6) for i, name in enumerate(finger.twin.joints)},
            "rmse_rad": _rms(measured - predicted[shown, column]),
            "without_rmse_rad": _rms(measured - excerpt.without[shown, column]),
            "server_s": time.perf_counter() - began,
        }

    def _finger(self, path: str, version: str, joint: str, found: Comparison) -> _Finger:
        twin, key = self._cache.twin(version), (path, version, joint)
        kept = self._fingers.pop(key, None)
        if kept is None or kept.found is not found:
            part = next((one for one in parts(twin) if joint in one.joints), None)
            if part is None:
                raise BadInput(f"no joint '{joint:.60}'", todo=nearest(joint, twin.joints))
            moving = {name for name, moves in zip(found.aligned.joints, found.aligned.moving, strict=True) if moves}
            keep = {joint, *(moving & {*part.joints, *part.trunk})}
            small = submodel(twin, with_coupled(twin, keep), found.aligned.start_position)
            kept = _Finger(found, small, restricted(found.aligned, small))
        self._fingers[key] = kept
        while len(self._fingers) > _MOST_FINGERS:
            self._fingers.pop(next(iter(self._fingers)))
        return kept

    def _cut(self, finger: _Finger, from_s: float, until_s: float) -> _Excerpt:
        kept = self._excerpt
        if kept is not None and kept.finger is finger and kept.span == (from_s, until_s):
            return kept
        start = max(from_s - _RUN_IN_S, 0.0)
        aligned = stretch(finger.aligned, start, until_s - start) if until_s > from_s else None
        if aligned is None:
            raise BadInput("the view holds no sample that knows every joint of the finger", todo="Show another stretch")
        begin_s = finger.aligned.onset_s - aligned.onset_s
        without = predict(finger.twin, aligned, threads=1)
        self._excerpt = _Excerpt(finger, (from_s, until_s), aligned, begin_s, without)
        return self._excerpt


def _effect(request: Request) -> Effect:
    key = request.query_params.get("effect", "")
    if key not in LIBRARY:
        raise BadInput(f"no effect '{key:.60}'", todo=nearest(key, list(LIBRARY)))
    return LIBRARY[key]


def require_fit(effect: Effect, place: Place) -> None:
    """Raises BadInput where the effect cannot act at the place."""
    if not effect.applies(place):
        raise BadInput(f"'{effect.key}' acts on: {effect.acts_on}; not on {place.target}", todo="Choose another place")


def _given(request: Request) -> Mapping[str, float]:
    values = {}
    for text in request.query_params.getlist("value"):
        name, _, figure = text.partition(":")
        try:
            values[name] = float(figure)
        except ValueError:
            raise BadInput(f"'{text:.60}' is no NAME:NUMBER", where="value") from None
    return values


def _rms(residual: np.ndarray) -> float | None:
    known = residual[np.isfinite(residual)]
    return float(np.sqrt(np.mean(known**2))) if known.size else None
