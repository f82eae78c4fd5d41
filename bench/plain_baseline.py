"""What a competent engineer would do by hand, as a baseline beside `twin diagnose`.

    python -m bench.plain_baseline --model FILE.xml --recording BAG --holdout BAG --json PATH

Each effect at each place is fitted alone: scipy's least squares over a plain roll-out of the whole robot, all other
parameters at their nominal values, from the best of the effect's own starts. The lowest error on the held-out motion
wins. Models of effects are the library's; nothing of the diagnosis is used: no nuisances, no evidence, no gate.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from twin_daemon.effects import LIBRARY
from twin_daemon.effects.base import Effect, Parameter
from twin_daemon.errors import BadInput
from twin_daemon.hand import load_hand
from twin_daemon.recordings import load_recording
from twin_daemon.recordings.noise import noise_variance
from twin_daemon.simulation.alignment import Aligned, align, predict
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.workflows.session import silence_mujoco

_SOUND = 1.5  # an rms error of so many times the sensors' noise at every joint is none
_WORTH = 0.95  # of the nominal held-out error: what does not get below explains nothing
_ITERATIONS = 5
_FIT_HZ = 100.0
_LOST = 1e3  # the error of a roll-out that diverges, in parts of the noise
_EVERYWHERE = ("command_delay", "actuator_lag", "actuator_gain")


@dataclass(frozen=True)
class Candidate:
    """An effect at one place, or with the same values at all servos."""

    effect: Effect
    targets: tuple[str, ...]

    @property
    def name(self) -> str:
        """effect:place"""
        return f"{self.effect.key}:{self.targets[0] if len(self.targets) == 1 else 'robot'}"

    def terms(self, values: Mapping[str, float]) -> Terms:
        complete = self.effect.complete(self.effect.clipped(values))
        return Terms(effects=tuple(EffectTerm(effect=self.effect.key, target=t, values=complete) for t in self.targets))


@dataclass(frozen=True)
class Fit:
    """A candidate's values and its mean squared errors, in parts of the noise, fitted and held out."""

    candidate: Candidate
    values: dict[str, float]
    fitted: float
    held: float


class Bench:
    """One robot's nominal model with the motion to fit and the motion to judge by."""

    def __init__(self, model: Path, recording: Path, holdout: Path) -> None:
        self.twin = TwinModel.load(load_hand(model=model))
        self.fit, self.held = (align(self.twin, load_recording(path)) for path in (recording, holdout))
        variance = [noise_variance(column) for column in self.fit.measured.T]
        self.noise = np.sqrt(np.maximum(variance, 1e-14))

    def residual(self, twin: TwinModel, aligned: Aligned) -> np.ndarray:
        """(n, j) measured minus predicted in parts of each joint's noise, at 100 Hz or the recording's own rate."""
        every = max(1, round(len(aligned.time_s) / (float(aligned.time_s[-1]) * _FIT_HZ)))
        gap = (aligned.measured - predict(twin, aligned))[::every] / self.noise
        return np.clip(np.nan_to_num(gap, nan=_LOST, posinf=_LOST, neginf=-_LOST), -_LOST * 100, _LOST * 100)

    def sound(self) -> bool:
        """Whether the nominal model leaves nothing but noise on the held-out motion."""
        return bool(np.all(np.sqrt(np.mean(self.residual(self.twin, self.held) ** 2, axis=0)) < _SOUND))

    def candidates(self) -> Iterator[Candidate]:
        """Each effect of the library at each place where it can act, and what may be common to all servos."""
        places = list(dict.fromkeys((*self.twin.joints, *self.twin.actuators, "hand")))
        for effect in LIBRARY.values():
            for target in places:
                if effect.applies(self.twin.place(target)):
                    yield Candidate(effect, (target,))
            if effect.key in _EVERYWHERE and len(self.twin.actuators) > 1:
                yield Candidate(effect, self.twin.actuators)

    def fitted(self, candidate: Candidate) -> Fit | None:
        """The candidate at its best from the best of its starts; None where the model cannot have it."""
        effect = candidate.effect
        place = candidate.targets[0] if candidate.targets[0] != "hand" else self.twin.joints[0]
        starts = [effect.complete(effect.clipped(s)) for s in effect.starts(self.twin.scale(place))]
        free = [p for p in effect.parameters if not p.held]
        if not starts:
            return None

        def errors(values: Mapping[str, float]) -> np.ndarray:
            try:
                return self.residual(self.twin.changed(candidate.terms(values)), self.fit).ravel()
            except BadInput:
                return np.full(1, _LOST)

        start = min(starts, key=lambda values: float(np.mean(errors(values) ** 2)))
        if errors(start).size == 1:
            return None
        scales = np.array([_scale(p, starts) for p in free])

        def values_at(x: np.ndarray) -> dict[str, float]:
            moved = {p.name: _from(p, v) for p, v in zip(free, x * scales, strict=True)}
            return effect.clipped(start | moved)

        begun = np.array([_to(p, start[p.name]) for p in free]) / scales
        size = errors(start).size

        def residuals(x: np.ndarray) -> np.ndarray:
            found = errors(values_at(x))
            return found if found.size == size else np.full(size, _LOST)

        best = least_squares(residuals, begun, diff_step=0.02, max_nfev=_ITERATIONS)
        values = values_at(best.x)
        held = self.residual(self.twin.changed(candidate.terms(values)), self.held)
        return Fit(candidate, values, float(np.mean(best.fun**2)), float(np.mean(held**2)))


def _to(p: Parameter, value: float) -> float:
    return float(np.log(value)) if p.log and p.lower > 0 else value


def _from(p: Parameter, value: float) -> float:
    return float(np.exp(min(value, 50.0))) if p.log and p.lower > 0 else float(value)


def _scale(p: Parameter, starts: list[dict[str, float]]) -> float:
    """What is one step of a parameter: its largest start, 1 in logarithms."""
    if p.log and p.lower > 0:
        return 1.0
    return max([abs(start[p.name]) for start in starts] + [abs(p.default) * 1e-3, 1e-6])


def diagnosed(model: Path, recording: Path, holdout: Path) -> dict[str, Any]:
    """Verdict and findings as `twin diagnose` has them; `tried` holds the held-out errors of the best ten."""
    began = time.monotonic()
    bench = Bench(model, recording, holdout)
    nominal = float(np.mean(bench.residual(bench.twin, bench.held) ** 2))
    answer: dict[str, Any] = {"schema": 1, "verdict": "within_noise", "findings": [], "tried": []}
    if not bench.sound():
        fits = [fit for fit in map(bench.fitted, bench.candidates()) if fit is not None]
        fits.sort(key=lambda fit: fit.held)
        answer["candidates"] = len(fits)
        answer["tried"] = [{"name": fit.candidate.name, "held_over_nominal": fit.held / nominal} for fit in fits[:10]]
        answer["verdict"] = "unexplained"
        if fits and fits[0].held < _WORTH * nominal:
            answer["verdict"] = "explained"
            answer["findings"] = [_finding(bench.twin, fits[0])]
    return answer | {"wall_s": time.monotonic() - began}


def _finding(twin: TwinModel, fit: Fit) -> dict[str, Any]:
    targets = fit.candidate.targets
    joints = [joint for target in targets for joint in (target, *twin.joints_of(target)) if joint in twin.joints]
    joints = list(twin.joints) if targets == ("hand",) else list(dict.fromkeys(joints))
    values = {name: {"value": value, "ci95": None} for name, value in fit.values.items()}
    return {"effect": fit.candidate.effect.key, "joints": joints, "parameters": values, "confusable_with": []}


def main() -> None:
    """Writes the answer for one robot and its two recordings."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    for name in ("model", "recording", "holdout", "json"):
        parser.add_argument(f"--{name}", type=Path, required=True)
    given = parser.parse_args()
    silence_mujoco()
    given.json.write_text(json.dumps(diagnosed(given.model, given.recording, given.holdout), indent=1) + "\n")


if __name__ == "__main__":
    main()
