"""How long `twin diagnose` takes for the whole hand on 30 s of rich motion, and what it says.

python -m bench.whole_hand
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from twin_daemon.hand import load_hand
from twin_daemon.plant import Plant, parse_hidden
from twin_daemon.plant.motions import rich
from twin_daemon.plant.recording import record

_SEED = 3
_SPREAD = 0.2
_CASES: tuple[tuple[str, ...], ...] = (
    (),
    ("sensor_gain:FFJ3=severe",),
    ("viscous_friction:MFJ3=severe",),
    ("backlash:FFJ3=severe",),
    ("sensor_gain:FFJ3=severe", "viscous_friction:MFJ3=severe"),
    ("x_sticky_patch:FFJ3=severe",),
)


def main() -> None:
    """One line a case: what was hidden, how long it took from the command to its end, and the answer."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    hand = load_hand()
    twin = str(Path(sys.executable).parent / "twin")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for number, hidden in enumerate(_CASES):
            plant = Plant(hand, seed=_SEED, hidden=[parse_hidden(h, hand) for h in hidden], spread=_SPREAD)
            paths = [folder / f"{number}-{which}.mcap" for which in ("fit", "held")]
            for path, seconds, seed in zip(paths, (30.0, 15.0), (_SEED, _SEED + 100), strict=True):
                record(plant, rich(hand, (), seconds, seed), path, jitter_s=0.0005, seed=seed)
            result = folder / f"{number}.json"
            told = [twin, "diagnose", "--recording", str(paths[0]), "--holdout", str(paths[1]), "--json", str(result)]
            began = time.perf_counter()
            subprocess.run(told, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)
            seconds = time.perf_counter() - began
            said = json.loads(result.read_text())
            named = ", ".join(f"{f['effect']}:{f['target']}" for f in said["findings"]) or "-"
            print(f"{' + '.join(hidden) or 'nothing':55s} {seconds:5.0f} s  {said['verdict']:13s} {named}", flush=True)


if __name__ == "__main__":
    main()
