"""One slow closing shows little: what the diagnosis says of it, and whether the motion it then asks for settles it.

    python -m bench.poor_motion [--page docs/poor-motion.md]

For each hidden effect a hand closes slowly once. The diagnosis may name the effect, or say that it cannot tell; a wrong
name is wrong. Where it proposes an experiment the same hand carries it out, and both recordings are diagnosed together.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

from bench.machine import in_words, provenance
from twin_daemon.resources import twin_command

_HIDDEN = (
    "backlash:rh_FFJ3=0.05",
    "viscous_friction:rh_MFJ3",
    "viscous_friction:rh_MFJ3=severe",
    "coulomb_friction:rh_FFJ3",
    "command_delay:rh_FFJ3",
    "tendon_elasticity:rh_RFJ3",
    "tendon_elasticity:rh_RFJ3=severe",
    "spring:rh_FFJ3",
    "sensor_gain:rh_FFJ3",
    "",
)
_PAGE = """# One slow closing

Made by `python -m bench.poor_motion`: the stand-in hand, its parameters up to 20 % off, closes slowly once. Where the
diagnosis proposes an experiment, the same hand carries it out and both recordings are diagnosed together. Effects
without a value are mild: some of these hide in parameters that are 20 % off, and then no motion shows them.

| hidden | one slow closing | named | proposed | with the experiment | named | s |
|---|---|---|---|---|---|---|
"""


def twin(folder: Path, *arguments: str) -> None:
    """Runs one command; raises where it fails."""
    environment = {**os.environ, "TWIN_STATE_DIR": str(folder / "state")}
    subprocess.run(twin_command(*arguments), cwd=folder, env=environment, check=True, capture_output=True)


def diagnosed(folder: Path, *recordings: str) -> dict[str, Any]:
    """What `twin diagnose` writes of some recordings."""
    twin(folder, "diagnose", "--recording", *recordings, "--version", "nominal", "--json", "said.json")
    return json.loads((folder / "said.json").read_text())


def named(said: dict[str, Any]) -> str:
    return ", ".join(f"{one['effect']}:{one['target']}" for one in said["findings"]) or "-"


def main() -> None:
    """One line a hidden effect."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--page", type=Path, help="Markdown page with the table")
    arguments = parser.parse_args()
    about = provenance("python -m bench.poor_motion")
    rows = []
    for hidden in _HIDDEN:
        began_s = time.monotonic()
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            hides = ["--hidden", hidden] if hidden else []
            twin(folder, "hand", *hides, "--trajectory", "slow_closing", "-o", "slow.mcap")
            first = diagnosed(folder, "slow.mcap")
            proposed, second = first.get("next_experiment"), None
            if proposed is not None:
                twin(folder, "hand", *hides, "--trajectory", proposed["trajectory"], "-o", "more.mcap")
                second = diagnosed(folder, "slow.mcap", "more.mcap")
            cells = [hidden or "nothing", first["verdict"], named(first)]
            cells += ["-" if proposed is None else proposed["trajectory"].rpartition(":")[2]]
            cells += ["-", "-"] if second is None else [second["verdict"], named(second)]
            rows.append("| " + " | ".join([*cells, f"{time.monotonic() - began_s:.0f}"]) + " |")
            print(rows[-1], flush=True)
    if arguments.page:
        arguments.page.write_text(_PAGE + "\n".join([*rows, "", in_words(about)]) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
