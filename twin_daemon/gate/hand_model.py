"""All that a gate knows of its hand by a model: replaced as a whole, when another version of the twin is taken up."""

from __future__ import annotations

from dataclasses import dataclass

from twin_daemon.gate.expected import Expected
from twin_daemon.gate.limits import Limits
from twin_daemon.gate.planning import Planner
from twin_daemon.gate.preview import Preview
from twin_daemon.gate.settings import GateSettings
from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True)
class HandModel:
    """A model's geometry ahead of the hand, its motion beside the hand, and the planner."""

    preview: Preview
    planner: Planner
    expected: Expected

    @staticmethod
    def of(twin: TwinModel, limits: Limits, settings: GateSettings) -> HandModel:
        """What a gate with these limits looks ahead and rehearses with. Takes some milliseconds."""
        return HandModel(
            Preview(twin, settings.collision_depth_m),
            Planner(twin, limits, settings),
            Expected(twin, limits, 1.0 / settings.rate_hz),
        )
