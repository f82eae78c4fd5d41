"""`twin compare --rrd`: what Rerun's own reader finds in the file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.simulation.made import worn_finger
from twin_daemon.cli.app import main
from twin_daemon.hand import load_hand
from twin_daemon.recordings import load_recording
from twin_daemon.simulation.twin import TwinModel

chunks = pytest.importorskip("rerun.chunk", reason="the extra 'rerun' is not installed")


def curves(path: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """(stamps in ns, values) by entity."""
    found: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for chunk in chunks.RrdReader(path).stream():
        if chunk.is_static or "Scalars:scalars" not in (batch := chunk.to_record_batch()).schema.names:
            continue
        stamps = batch.column("time").to_numpy(zero_copy_only=False).astype("datetime64[ns]").astype(np.int64)
        values = np.array([one[0] for one in batch.column("Scalars:scalars").to_pylist()])
        found.setdefault(chunk.entity_path, []).append((stamps, values))
    joined = {name: tuple(np.concatenate(parts) for parts in zip(*each, strict=True)) for name, each in found.items()}
    return {name: (x[order := np.argsort(x)], y[order]) for name, (x, y) in joined.items()}


def test_a_comparison_opens_in_rerun(tmp_path: Path) -> None:
    bag, file = worn_finger(TwinModel.load(load_hand()), tmp_path / "worn.mcap"), tmp_path / "worn.rrd"
    told = tmp_path / "told.json"
    assert main(["compare", "--recording", str(bag), "--rrd", str(file), "--json", str(told)]) == 0
    compared, recording = json.loads(told.read_text()), load_recording(bag)
    found = curves(file)
    parts = ("angle/measured", "angle/commanded", "angle/predicted", "residual")
    assert set(found) == {f"/{joint}/{part}" for joint in ("rh_FFJ1", "rh_FFJ2", "rh_FFJ3") for part in parts}
    stamps, measured = found["/rh_FFJ3/angle/measured"]
    assert stamps.tolist() == recording.stamp_ns.tolist()
    assert measured == pytest.approx(recording.position[:, recording.joints.index("rh_FFJ3")])
    residual_rad = 1e-3 * found["/rh_FFJ3/residual"][1]
    assert residual_rad == pytest.approx(measured - found["/rh_FFJ3/angle/predicted"][1], abs=1e-12)
    assert np.mean(residual_rad**2) == pytest.approx(compared["joints"]["rh_FFJ3"]["mse_rad2"])
    assert recording.commands is not None
    commanded = recording.commands.position[:, recording.commands.names.index("rh_FFJ3")]
    assert set(np.round(found["/rh_FFJ3/angle/commanded"][1], 9)) <= set(np.round(commanded, 9))
    assert chunks.RrdReader(file).blueprints(), "it opens with the worst joints side by side"
    assert [one.name for one in tmp_path.iterdir() if one.name.startswith(".")] == []


def test_a_file_that_cannot_be_written_leaves_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = worn_finger(TwinModel.load(load_hand()), tmp_path / "worn.mcap")
    (tmp_path / "there.rrd").mkdir()
    (tmp_path / "there.rrd" / "something").touch()
    assert main(["compare", "--recording", str(bag), "--rrd", str(tmp_path / "there.rrd")]) == 3
    assert "there.rrd" in capsys.readouterr().err
    assert sorted(one.name for one in tmp_path.iterdir()) == ["there.rrd", "worn.mcap"]
