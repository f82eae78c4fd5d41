"""One finger of the hand, lying so that gravity loads it, and a short motion that shows most effects."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pytest

from twin_daemon.effects import LIBRARY
from twin_daemon.hand import load_hand
from twin_daemon.simulation.rollout import roll_out
from twin_daemon.simulation.submodel import submodel
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

FINGER = ("rh_FFJ4", "rh_FFJ3", "rh_FFJ2", "rh_FFJ1")
PLACES = ("rh_FFJ3", "rh_FFJ0", "rh_FFJ1", "hand")
# time s, share of the range: a fast step, a hold, a slow ramp, small reversals, a step back
_WAYPOINTS = np.array(
    [[0, 0.5], [0.2, 0.5], [0.22, 0.8], [0.6, 0.8], [1.3, 0.5], [1.4, 0.54], [1.5, 0.5], [1.6, 0.54], [1.7, 0.5],
     [1.9, 0.5], [2.0, 0.75], [2.4, 0.75]]
)  # fmt: skip


@dataclass(frozen=True)
class Bench:
    """A twin without effects and a motion of its commands, (T, nu) rad."""

    twin: TwinModel
    controls: np.ndarray
    still: np.ndarray  # (T + 1, j) rad: how it moves without effects

    def with_effects(self, *effects: tuple[str, str, Mapping[str, float]]) -> TwinModel:
        """The twin with (key, target, values) in this order."""
        terms = tuple(EffectTerm(effect=key, target=target, values=dict(values)) for key, target, values in effects)
        return self.twin.changed(Terms(effects=terms))

    def move(self, twin: TwinModel) -> np.ndarray:
        """Readings of the motion, (T + 1, j) rad."""
        return move(twin, self.controls)

    def places(self, key: str) -> list[str]:
        """Where an effect can act on this bench."""
        known = [p for p in PLACES if p == "hand" or p in (*self.twin.joints, *self.twin.actuators)]
        return [target for target in known if LIBRARY[key].applies(self.twin.place(target))]


def move(twin: TwinModel, controls: np.ndarray) -> np.ndarray:
    """Readings (T + 1, j) rad from rest at the first target."""
    start = np.linalg.lstsq(twin.drive, controls[0], rcond=None)[0]
    positions = roll_out([twin.model], controls[None], twin.initial_qpos(start)[None])[0]
    return twin.measurement.apply(twin.joints, positions[:, twin.qpos_adr])


def rich_controls(twin: TwinModel) -> np.ndarray:
    """(T, nu) rad: the waypoints over each command's range, a little later for each."""
    step_s = twin.model.opt.timestep
    times = np.arange(round(_WAYPOINTS[-1, 0] / step_s)) * step_s
    low, high = twin.base_model.actuator_ctrlrange[: len(twin.actuators)].T
    shares = [np.interp(times + 0.05 * i, *_WAYPOINTS.T) for i in range(len(twin.actuators))]
    return low + (high - low) * np.stack(shares, axis=1)


def loaded_finger(change: Callable[[object], None] | None = None) -> TwinModel:
    """The first finger alone with gravity across it; `change` edits its nominal MjSpec."""
    hand = TwinModel.load(load_hand())
    finger = submodel(hand, FINGER, np.zeros(len(hand.joints)))
    spec = finger.nominal.copy()
    spec.option.gravity = np.array([2.0, 8.0, -5.0])
    if change is not None:
        change(spec)
    return TwinModel(finger.hand, spec, Terms())


@pytest.fixture(scope="session")
def bench() -> Bench:
    twin = loaded_finger()
    controls = rich_controls(twin)
    return Bench(twin, controls, move(twin, controls))
