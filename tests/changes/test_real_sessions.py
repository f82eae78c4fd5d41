"""The real hand, months apart: what has changed runs to its end, and every number has its interval."""

from __future__ import annotations

import json
from itertools import combinations
from pathlib import Path

import pytest

from twin_daemon.cli.app import main
from twin_daemon.errors import BadInput
from twin_daemon.recordings import load_recording
from twin_daemon.recordings.recording import Recording

MONTHS_S = 60 * 86400


def _sessions(folder: Path) -> list[tuple[Path, Recording]]:
    found = []
    for path in sorted(folder.glob("*.csv")) + sorted(folder.glob("*.bag")):
        try:
            found.append((path, load_recording(path)))
        except BadInput:
            continue
    return sorted(found, key=lambda one: int(one[1].stamp_ns[0]))


@pytest.mark.slow
def test_real_sessions_months_apart_are_compared_with_intervals(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "shadow_hand_real"
    trajectories = folder / "trajectories.yaml"
    for (older, first), (newer, second) in combinations(_sessions(folder), 2):
        # the same motion comes in the same form: that of the fingers as a table, that of the thumb as a bag
        apart_s = (int(second.stamp_ns[0]) - int(first.stamp_ns[0])) * 1e-9
        if apart_s > MONTHS_S and set(first.joints) & set(second.joints) and older.suffix == newer.suffix:
            break
    else:
        pytest.skip("shadow_hand_real holds one session of each motion: no second one that is months apart")
    answer = tmp_path / "since.json"
    motion = f"{trajectories}:{newer.stem}"
    given = ["--baseline", str(older), "--recording", str(newer), "--trajectory", motion]
    assert main(["diagnose", *given, "--json", str(answer)]) == 0
    found = json.loads(answer.read_text())
    for change in found["changes"]:
        assert change["now"]["ci95"][0] <= change["now"]["value"] <= change["now"]["ci95"][1]
        assert 0.0 < change["probability"] <= 1.0
    assert found["changes"] or found["unchanged"] or found["undetectable"] or found["notes"]
