"""A small hand's worth of versions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from twin_daemon.versions import Draft, ParameterRecord, VersionStore

MJCF = """<mujoco>
  <worldbody><body><joint name="FFJ3" type="hinge"/><geom size="0.01" mass="0.1"/></body></worldbody>
</mujoco>
"""


@pytest.fixture
def store(tmp_path: Path) -> VersionStore:
    return VersionStore("hand", root=tmp_path / "hand", shipped=tmp_path / "shipped")


@pytest.fixture(scope="session")
def draft() -> Callable[..., Draft]:
    """A draft that differs from another by its damping."""

    def make(damping: float = 0.1, **changed: object) -> Draft:
        content = {
            "hand": "hand",
            "kind": "calibrated",
            "terms": {"schema": 1, "parameters": {"FFJ3.damping": damping}, "effects": []},
            "parameters": {
                "FFJ3.damping": ParameterRecord(
                    value=damping, unit="N m s/rad", lower=0.0, upper=1.0, ci95=(damping - 0.01, damping + 0.01)
                )
            },
            "errors": {"before": {"mse_rad2": 1e-3}, "after": {"mse_rad2": 1e-5}},
            "seed": 1,
        }
        return Draft.model_validate({**content, **changed})

    return make


@pytest.fixture(scope="session")
def mjcf() -> str:
    return MJCF
