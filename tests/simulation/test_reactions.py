"""Torques on a part by what moves beside it, in steps of any length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from twin_daemon.effects.base import Measurement
from twin_daemon.simulation.reactions import Reaction
from twin_daemon.simulation.twin import TwinModel

_CELL_S = 5e-4


@dataclass(frozen=True)
class _Pulse:
    """80 N m for two cells, and nothing before and after."""

    joints: tuple[str, ...]
    measurement: Measurement
    begin: int

    @property
    def time_s(self) -> np.ndarray:
        return (np.arange(400) + 0.5) * _CELL_S

    @property
    def position(self) -> np.ndarray:
        return np.zeros((400, len(self.joints)))

    def torque(self, rows: slice, moved: np.ndarray | None = None) -> np.ndarray:
        out = np.zeros((400, len(self.joints)))
        out[self.begin : self.begin + 2, 0] = 80.0
        return out[rows]


@pytest.mark.parametrize("step_s", [5e-4, 0.002, 0.004])
@pytest.mark.parametrize("begin", [101, 102, 103])
def test_a_pulse_that_is_shorter_than_a_step_keeps_its_impulse(twin: TwinModel, step_s: float, begin: int) -> None:
    at = twin.at_step(step_s)
    reaction = Reaction.along(_Pulse(twin.joints, twin.measurement, begin)).shifted(0.0123)
    forces = reaction.applied(at, np.arange(round(0.15 / step_s)) * step_s)
    dof = twin.dof_adr[0]
    assert forces[:, dof].sum() * step_s == pytest.approx(80.0 * 2 * _CELL_S, rel=1e-9)
    # and its moment: it comes when it came, to a fraction of a step
    when = (forces[:, dof] * np.arange(len(forces))).sum() * step_s / forces[:, dof].sum()
    assert when == pytest.approx((begin + 1) * _CELL_S - 0.0123, abs=0.5 * step_s)
