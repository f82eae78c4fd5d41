"""Diagnose, add and watch: what the page starts, and how what came of it is shown."""

from __future__ import annotations

import time
from typing import Any, get_args

import numpy as np
from pydantic import ValidationError
from starlette.requests import Request
from starlette.routing import BaseRoute

from twin_daemon.diagnosis.verdict import Diagnosis, LadderResult
from twin_daemon.effects import LIBRARY
from twin_daemon.errors import BadInput
from twin_daemon.places import HAND, ROBOT
from twin_daemon.proposals.proposal import Proposals
from twin_daemon.signals.trajectory import load_trajectory
from twin_daemon.simulation.follow import follow
from twin_daemon.simulation.signature import signature
from twin_daemon.versions import NOMINAL
from twin_daemon.web.app import posting, reading
from twin_daemon.web.jobs import Job, Jobs, Kind
from twin_daemon.web.library import Library
from twin_daemon.web.model_cache import ModelCache
from twin_daemon.web.numbers import listed
from twin_daemon.workflows.change import known_effect

_MOST_STEPS = 12
_MOST_CURVES = 8
_LONGEST_S = 86_400.0
_LONGEST_NAME = 60
_MOST_POINTS = 1500  # of a curve


class Learn:
    """The questions of the view. `data_options` say how recordings are read, as at the start of the workbench."""

    def __init__(self, library: Library, cache: ModelCache, jobs: Jobs, data_options: list[str]) -> None:
        self._library, self._cache, self._jobs = library, cache, jobs
        self._data_options = data_options

    @property
    def routes(self) -> list[BaseRoute]:
        return [
            reading("/api/effects", lambda _: self._effects()),
            reading("/api/effect", self._effect),
            reading("/api/job", self._job),
            reading("/api/experiment", lambda _: self._experiment()),
            posting("/api/job/check", self._check),
            posting("/api/job/diagnose", self._diagnose),
            posting("/api/job/propose", self._propose),
            posting("/api/job/add", self._add),
            posting("/api/job/ladder", self._ladder),
            posting("/api/job/stop", self._stop),
        ]

    # -- starting ------------------------------------------------------------------------------------------

    def _check(self, body: dict[str, Any]) -> dict[str, Any]:
        arguments, about = self._common({**body, "holdout": None})
        return self._begun("check", arguments, about)

    def _diagnose(self, body: dict[str, Any]) -> dict[str, Any]:
        arguments, about = self._common(body)
        joints = body.get("joints") or []
        if joints:
            arguments += ["--joints", *(self._place(name) for name in joints)]
        limit_s = body.get("within_s")
        if limit_s is not None:
            if isinstance(limit_s, bool) or not isinstance(limit_s, (int, float)) or not 1.0 <= limit_s <= _LONGEST_S:
                raise BadInput(f"within_s is {limit_s!s:.40}", allowed=f"1 to {_LONGEST_S:.0f} s")
            arguments += ["--within", f"{limit_s:.0f}"]
        return {"number": self._jobs.start("diagnose", arguments, about, limit_s).number}

    def _propose(self, body: dict[str, Any]) -> dict[str, Any]:
        """The law that the last diagnosis of the same data and version has not named; of others it diagnoses first."""
        arguments, about = self._common(body)
        job = self._jobs.latest("diagnose")
        if job is not None and job.result is not None and job.about == about:
            arguments += ["--diagnosis", str(job.path)]
        return self._begun("propose", arguments, about)

    def _add(self, body: dict[str, Any]) -> dict[str, Any]:
        arguments, about = self._common(body)
        effect, place = str(body.get("effect", "")), self._place(body.get("joint"))
        known_effect(effect[:_LONGEST_NAME])
        values = body.get("values")
        taken = self._found(about, effect, place) if values is None else _settings(effect, values)
        return self._begun(
            "add", [effect, "--joint", place, *taken, *arguments], about | {"effect": effect, "joint": place}
        )

    def _ladder(self, body: dict[str, Any]) -> dict[str, Any]:
        arguments, about = self._common(body)
        steps = body.get("max_steps", 6)
        if not isinstance(steps, int) or not 0 <= steps <= _MOST_STEPS:
            raise BadInput(f"max_steps is {steps!s:.40}", allowed=f"0 to {_MOST_STEPS}")
        return self._begun("ladder", [*arguments, "--max-steps", str(steps)], about)

    def _stop(self, _body: dict[str, Any]) -> dict[str, Any]:
        self._jobs.stop()
        return {}

    def _common(self, body: dict[str, Any]) -> tuple[list[str], dict[str, str]]:
        """(options of the command, what it is about)."""
        path = self._library.path(str(body.get("recording", "")))
        version = self._cache.version_id(str(body.get("version") or NOMINAL))
        arguments = ["--recording", str(path), "--version", version, *self._data_options]
        if body.get("holdout"):
            arguments += ["--holdout", str(self._library.path(str(body["holdout"])))]
        about = {"recording": path.name, "recording_id": str(body["recording"]), "version": version}
        return arguments, about | {"holdout": str(body.get("holdout") or "")}

    def _found(self, about: dict[str, str], effect: str, place: str) -> list[str]:
        """Options that take over what the last diagnosis of the same data and version found; none where it did not."""
        job = self._jobs.latest("diagnose")
        if job is None or job.result is None or job.about != about:
            return []
        names = [(one["effect"], one["target"]) for one in job.result["findings"]]
        return ["--finding", f"{job.path}:{names.index((effect, place)) + 1}"] if (effect, place) in names else []

    def _place(self, name: object) -> str:
        """The twin's name of a joint, a command or the whole hand; what is none is never an option of a command."""
        return self._cache.nominal.place(str(name)).target

    def _begun(self, kind: Kind, arguments: list[str], about: dict[str, str]) -> dict[str, Any]:
        return {"number": self._jobs.start(kind, arguments, about).number}

    # -- showing -------------------------------------------------------------------------------------------

    def _effects(self) -> dict[str, Any]:
        effects = [
            {"key": kind.key, "title": kind.title, "acts_on": kind.acts_on, "story": vars(kind.story)}
            for kind in LIBRARY.values()
        ]
        nominal = self._cache.nominal
        places = list(dict.fromkeys([*nominal.joints, *nominal.actuators, HAND, ROBOT]))
        return {"effects": effects, "places": places}

    def _effect(self, request: Request) -> dict[str, Any]:
        """What a typical amount of an effect does to a motion of the model. Nothing moves."""
        key, place = (request.query_params.get(name, "") for name in ("effect", "place"))
        found = signature(self._cache.nominal, key, self._place(place))
        every = max(len(found.time_s) // _MOST_POINTS, 1)
        curves = {name: listed(getattr(found, name)[::every], 5) for name in ("commanded", "without", "with_effect")}
        words = f"A motion of {found.name} as commanded, without {key} and with it ({found.amounts})."
        return {"words": words, "name": found.name, "time_s": listed(found.time_s[::every], 4), **curves}

    def _job(self, request: Request) -> dict[str, Any]:
        """The last job of a kind: what it said after line `after` and, when it has ended, what came of it."""
        kinds: dict[str, Kind] = {kind: kind for kind in get_args(Kind)}
        kind = kinds.get(request.query_params.get("kind", ""))
        if kind is None:
            raise BadInput("no such work", allowed=", ".join(kinds))
        job = self._jobs.latest(kind)
        if job is None:
            return {"status": "none"}
        text = request.query_params.get("after", "0")
        after = int(text) if text.isdecimal() and len(text) < 9 else 0
        return {
            "status": job.status,
            "number": job.number,
            "about": job.about,
            "lines": job.lines[after:],
            "count": len(job.lines),
            "error": job.error,
            "limit_s": job.limit_s,
            "seconds": (job.ended_s or time.time()) - job.began_s,
            "result": None if job.result is None else self._shown(job),
        }

    def _shown(self, job: Job) -> dict[str, Any]:
        assert job.result is not None
        if job.kind == "check":
            return job.result
        try:
            if job.kind == "diagnose":
                found = Diagnosis.model_validate(job.result)
                return found.model_dump(mode="json", by_alias=True, exclude={"terms"}) | {"words": found.in_words}
            if job.kind == "propose":
                return Proposals.model_validate(job.result).model_dump(mode="json")
            if job.kind == "ladder":
                ladder = LadderResult.model_validate(job.result)
                steps = sum(step.effect is not None for step in ladder.steps)
                return {
                    "version": ladder.version if steps else None,
                    "words": f"{steps} effects were added. {ladder.reason}",
                    "steps": [step.model_dump(mode="json") for step in ladder.steps],
                    "noise_floor_rad2": ladder.noise_floor_rad2,
                }
        except ValidationError as error:
            raise BadInput(f"what twin {job.kind} wrote cannot be read: {error.errors()[0]['msg']}") from None
        errors = ("before", "after", "holdout_before", "holdout_after", "holdout_joints_before", "holdout_joints_after")
        about = ("version", "effect", "targets", "parameters", "notes", "finding")
        return {key: job.result.get(key) for key in (*about, *errors)}

    def _experiment(self) -> dict[str, Any]:
        """The motion that the last diagnosis proposes, and how the twin would follow it. Nothing moves."""
        job = self._jobs.latest("diagnose")
        proposed = (job.result or {}).get("next_experiment") if job is not None else None
        if job is None or proposed is None:
            raise BadInput("the last diagnosis proposes no experiment")
        twin = self._cache.twin(job.about["version"])
        plan = load_trajectory(proposed["trajectory"], twin.hand).by_command(twin.hand)
        step_s = float(twin.model.opt.timestep)
        time_s = np.arange(int(np.ceil(plan.times_s[-1] / step_s)) + 1) * step_s
        targets = np.stack([np.interp(time_s, plan.times_s, column) for column in plan.positions.T], axis=1)
        controls, positions = follow(twin, plan.joints, targets)
        driven = positions @ twin.drive.T
        travel = np.ptp(controls, axis=0)
        moving = [column for column in np.argsort(-travel) if travel[column] > 0.0][:_MOST_CURVES]
        every = max(len(time_s) // _MOST_POINTS, 1)
        curves = {
            twin.actuators[column]: {
                "commanded": listed(controls[::every, column], 5),
                "followed": listed(driven[::every, column], 5),
            }
            for column in moving
        }
        return {
            "time_s": listed(time_s[::every], 4),
            "curves": curves,
            "why": proposed["why"],
            "path": proposed["path"],
        }


def _settings(effect: str, values: object) -> list[str]:
    """The options that keep values as somebody has set them. Raises BadInput for what the effect does not take."""
    if not isinstance(values, dict) or not all(type(value) in (int, float) for value in values.values()):
        raise BadInput("the values of the effect are no numbers by name")
    found = LIBRARY[effect].complete({str(name): float(value) for name, value in values.items()})
    return ["--set", *(f"{name}={value!r}" for name, value in found.items())]
