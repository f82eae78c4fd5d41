"""A model with all that is built from it, made beside the loop: taking it up costs the loop no more than a sample."""

from __future__ import annotations

from dataclasses import dataclass

from twin_daemon.daemon.extrapolation import Extrapolation
from twin_daemon.daemon.kinematics import Kinematics
from twin_daemon.daemon.predictor import Predictor
from twin_daemon.daemon.settings import DaemonSettings
from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True)
class Ready:
    """What a service needs to go on with another model."""

    twin: TwinModel
    predictor: Predictor
    kinematics: Kinematics
    extrapolation: Extrapolation

    @classmethod
    def made(cls, twin: TwinModel, settings: DaemonSettings) -> Ready:
        predictor = Predictor(twin, settings.horizon_s, settings.max_catch_up_s)
        return cls(twin, predictor, Kinematics(twin), Extrapolation(twin))
