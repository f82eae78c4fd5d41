"""One recording of one plant of the home suite; the answer goes into a file of its own."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from itertools import chain
from pathlib import Path

from bench.home_cases import cases, conditions
from twin_daemon.hand import Hand, load_hand
from twin_daemon.plant import Plant, parse_hidden
from twin_daemon.plant.motions import rich, slow_closing
from twin_daemon.plant.recording import record

SPREAD = 0.2
JITTER_S = 0.0005


def main(name: str, which: str, folder: Path) -> None:
    """Writes `<name>-<which>.mcap` and, beside the recordings' folder, the sealed answer."""
    case = next(case for case in chain(cases(), *conditions().values()) if case.name == name)
    hand = _noisier(load_hand(), case.noise)
    plant = Plant(hand, seed=case.seed, hidden=[parse_hidden(text, hand) for text in case.hidden], spread=SPREAD)
    held = which == "held"
    if case.motion == "slow":
        motion = slow_closing(hand, seconds=5.6 if held else 7.0)
    else:
        motion = rich(hand, case.joints, case.seconds * (0.5 if held else 1.0), case.seed + 1000 * held)
    path = folder / f"{name}-{which}.mcap"
    path.unlink(missing_ok=True)  # of a run that was interrupted
    record(plant, motion, path, jitter_s=JITTER_S, seed=case.seed + 1000 * held)
    sealed = folder / "answers"
    sealed.mkdir(exist_ok=True)
    answer = [{"key": h.key, "joint": h.joint, "value": h.value} for h in plant.hidden]
    (sealed / f"{name}.json").write_text(json.dumps(answer))


def _noisier(hand: Hand, factor: float) -> Hand:
    """The hand with sensors that are so many times as noisy and as coarse."""
    joints = {
        name: one.model_copy(
            update={"noise_rad": one.noise_rad * factor, "resolution_rad": one.resolution_rad * factor}
        )
        for name, one in hand.description.joints.items()
    }
    return replace(hand, description=hand.description.model_copy(update={"joints": joints}))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], Path(sys.argv[3]))
