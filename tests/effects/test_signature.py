"""What an effect does to a motion, for every effect of the library."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from twin_daemon.cli.app import main
from twin_daemon.effects import LIBRARY
from twin_daemon.errors import BadInput
from twin_daemon.hand import load_hand
from twin_daemon.simulation.signature import signature
from twin_daemon.simulation.twin import TwinModel


@pytest.fixture(scope="module")
def twin() -> TwinModel:
    return TwinModel.load(load_hand())


@pytest.mark.parametrize("key", LIBRARY)
def test_every_effect_can_be_seen(key: str, twin: TwinModel) -> None:
    places = [name for name in ("rh_FFJ3", "rh_FFJ0", "hand") if LIBRARY[key].applies(twin.place(name))]
    for place in places[:1]:
        found = signature(twin, key, place)
        gap_rad = np.abs(found.with_effect - found.without)
        assert np.isfinite(gap_rad).all()
        assert gap_rad.max() > 1e-4
        assert found.values == LIBRARY[key].complete(found.values)
    assert places


def test_what_fits_nowhere_is_refused(twin: TwinModel) -> None:
    with pytest.raises(BadInput, match="Did you mean 'backlash'"):
        signature(twin, "backlsh", "rh_FFJ3")
    with pytest.raises(BadInput, match="acts on"):
        signature(twin, "coupling", "rh_FFJ3")


def test_it_is_drawn_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "backlash.html"
    assert main(["effects", "backlash", "--at", "rh_FFJ3", "--plot", str(path)]) == 0
    assert "with backlash" in path.read_text(encoding="utf-8")
    assert main(["effects", "--plot", str(path)]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
