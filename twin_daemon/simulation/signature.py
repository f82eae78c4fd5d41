"""What an effect does to a motion: the twin with and without it under the same commands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin_daemon.effects import LIBRARY
from twin_daemon.errors import BadInput, nearest
from twin_daemon.places import HAND, ROBOT
from twin_daemon.simulation.follow import follow
from twin_daemon.simulation.terms import EffectTerm
from twin_daemon.simulation.twin import TwinModel

_LEAST_SHARE, _MOST_SHARE = 0.3, 0.7
# A slow way there and back with a small reversal, a hold, two steps, then a fast wave: what tells effects apart.
_TIME_S = (0.0, 1.0, 3.0, 3.6, 4.2, 6.0, 7.0, 7.01, 8.0, 8.01, 9.0, 9.3, 9.6, 9.9, 10.2, 11.0)
_SHARE = (0.0, 0.0, 1.0, 0.8, 1.0, 0.0, 0.0, 0.6, 0.6, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0)


@dataclass(frozen=True)
class Signature:
    """Over `time_s` (n,): what was commanded, and what would be read without and with the effect, all (n,) rad of the
    joint or command `name`. `values` are those of the effect."""

    name: str
    values: dict[str, float]
    time_s: np.ndarray
    commanded: np.ndarray
    without: np.ndarray
    with_effect: np.ndarray

    @property
    def amounts(self) -> str:
        """The values of the effect in words."""
        return ", ".join(f"{name} {value:.3g}" for name, value in self.values.items())


def signature(twin: TwinModel, key: str, target: str) -> Signature:
    """A probing motion of one motor, by the twin and by the twin with a typical amount of the effect at `target`.

    Raises BadInput for an effect or place that is none, that do not fit, or that no motor moves.
    """
    if key not in LIBRARY:
        raise BadInput(f"no effect '{key:.60}'", todo=nearest(key, list(LIBRARY)))
    effect, place = LIBRARY[key], twin.place(target)
    if not effect.applies(place):
        raise BadInput(
            f"'{key}' acts on {'an' if effect.acts_on[0] in 'aeiou' else 'a'} {effect.acts_on}, not on {place.target}",
            todo="Choose another place",
        )
    # what acts on the whole hand is looked at where the hand moves first
    name = twin.actuators[0] if place.target in (HAND, ROBOT) else place.target
    driver = twin.place(name).actuator
    if driver is None:
        raise BadInput(f"no motor moves {name}", todo="Choose another place")
    column = int(twin.base_model.actuator(driver).id)
    starts = effect.starts(twin.scale(name))
    values = effect.complete(starts[len(starts) // 2])
    changed = twin.changed(twin.terms.with_effect(EffectTerm(effect=key, target=place.target, values=values)))
    low, high = twin.base_model.actuator_ctrlrange[column]
    if not low < high:
        low, high = -0.5, 0.5
    time_s = np.arange(0.0, _TIME_S[-1], float(twin.model.opt.timestep))
    share = _LEAST_SHARE + (_MOST_SHARE - _LEAST_SHARE) * np.interp(time_s, _TIME_S, _SHARE)
    commanded = low + (high - low) * share
    without, with_effect = (_read(one, name, column, commanded) for one in (twin, changed))
    return Signature(name, values, time_s, commanded, without, with_effect)


def _read(twin: TwinModel, name: str, column: int, commanded: np.ndarray) -> np.ndarray:
    """(n,) what the sensors say of `name` while one command moves and the others rest."""
    _, positions = follow(twin, (twin.actuators[column],), commanded[:, None])
    read = twin.measurement.apply(twin.joints, positions)
    return read[:, twin.joints.index(name)] if name in twin.joints else read @ twin.drive[twin.actuators.index(name)]
