"""The hand as it is, compiled once."""

from __future__ import annotations

import pytest

from twin_daemon.hand import load_hand
from twin_daemon.simulation.twin import TwinModel


@pytest.fixture(scope="session")
def twin() -> TwinModel:
    return TwinModel.load(load_hand())
