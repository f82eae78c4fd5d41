"""The searches of a dissertation, on its own recordings and in its own spaces, beside what this project does.

    python -m bench.dissertation [--bayes-seconds 600] [--seed 0]

T. Correia, FEUP 2023, tables 5.2, 5.3 and 5.5. Random search with 1000 points, a particle swarm of 10 over 100
iterations, and a Gaussian process with 500 calls or as many as the time allows; least squares beside them; then what
the error falls to with a larger space and with named effects. Half an hour; writes docs/dissertation.{json,md} and the
pictures of the evolutions.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

from bench.damping import damping_scan
from bench.dissertation_page import SPACES, page
from bench.evolution import draw
from bench.frame import LeftOut
from bench.machine import provenance
from bench.objective import Found, Objective, gaussian_process
from bench.real import real
from twin_daemon.calibration.calibrate import calibrate, judged
from twin_daemon.calibration.spaces import load_space
from twin_daemon.comparison.compare import raw_command_mse
from twin_daemon.errors import BadInput
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import VersionStore

_CALLS = 500
_OURS = {"random": 1000, "pso": 1000, "least-squares": None}


def main() -> None:
    """Measures, prints a line a search, and writes the results, the pictures and the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bayes-seconds", type=float, default=600.0, help="the most that a Gaussian process gets")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=Path("docs"), help="where the page, its data and pictures go")
    chosen = parser.parse_args()
    about = provenance(f"python -m bench.dissertation --bayes-seconds {chosen.bayes_seconds:g} --seed {chosen.seed}")
    try:
        spaces = {name: _space(name, chosen.bayes_seconds, chosen.seed) for name in SPACES}
        twin, thumb = real("thumb_calibration")
        result = {"schema": 1, **about, "spaces": spaces, "beyond": _beyond(chosen.seed),
                  "damping": [asdict(point) for point in damping_scan(twin, thumb)]}  # fmt: skip
    except LeftOut as reason:
        sys.exit(f"{reason}: nothing to compare with")
    (chosen.folder / "dissertation.json").write_text(json.dumps(result, indent=1) + "\n")
    (chosen.folder / "dissertation.md").write_text(page(result))
    for name, space in spaces.items():
        title = f"{SPACES[name].title}: the best error so far"
        draw(title, space["searches"], SPACES[name].best_rad2, chosen.folder / "pictures" / f"dissertation-{name}.svg")


def _space(name: str, seconds: float, seed: int) -> dict[str, Any]:
    """One table: every search from the same start, on the whole recording, as the dissertation fitted it."""
    twin, aligned = real(SPACES[name].motion)
    space = load_space(name)
    objective = Objective(twin, [aligned], [], space)
    searches = {}
    for search, budget in _OURS.items():
        fitted = calibrate(twin, [aligned], [], space, search, budget=budget, seed=seed)
        bound = [label for label, p in fitted.parameters.items() if p.at_bound]
        found = Found(twin.changed(fitted.terms), fitted.before_rad2, fitted.after_rad2, None, fitted.history,
                      fitted.wall_s, bound)  # fmt: skip
        searches[search] = _search(name, search, objective, found)
        if search == "least-squares":
            known = {p.identifiable for p in fitted.parameters.values()}
            searches[search]["identifiability"] = {
                word: sum(p.identifiable == word for p in fitted.parameters.values()) for word in known
            }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the Gaussian process warns when a point comes up twice
        searches["bayes"] = _search(name, "bayes", objective, objective.run(gaussian_process(_CALLS, seconds, seed)))
    raw = raw_command_mse(twin, aligned)
    return {
        "parameters": len(objective.variables),
        "joints": list(objective.joints),
        "start_rad2": objective.before_rad2,
        "nominal_rad2": objective.judged(twin)[0],
        "raw_command_rad2": sum(raw[j] for j in objective.joints) / len(objective.joints),
        "searches": searches,
    }


def _search(space: str, search: str, objective: Objective, found: Found) -> dict[str, Any]:
    print(f"{space:16} {search:14} {len(found.history):5} {found.wall_s:6.1f} s {found.after_rad2:.4g}", flush=True)
    groups = objective.twin.hand.description.groups
    return {
        "rad2": found.after_rad2,
        "by_group": {
            group: judged(found.twin, objective.train, own)[0]
            for group in SPACES[space].groups
            if (own := [j for j in groups[group] if j in objective.joints])
        },
        "evaluations": len(found.history),
        "wall_s": found.wall_s,
        "at_bound": found.at_bound,
        "history": _falls(found.history),
    }


def _falls(history: list[float]) -> list[tuple[int, float]]:
    """(evaluation, best error) wherever the best error falls, and at the end."""
    falls = [(i + 1, e) for i, e in enumerate(history) if i == 0 or e < history[i - 1]]
    return falls + ([(len(history), history[-1])] if falls and falls[-1][0] != len(history) else [])


def _beyond(seed: int) -> list[dict[str, Any]]:
    """What the closing's error falls to over the second approach's joints: a larger space, then named effects."""
    twin, aligned = real("hand_closing")
    joints = Objective(twin, [aligned], [], load_space("second-approach")).joints
    began = time.monotonic()
    fitted = calibrate(twin, [aligned], [], load_space("physical"), "least-squares", seed=seed)
    rows = [_row("physical space, least squares", twin.changed(fitted.terms), aligned, joints)]
    rows[0] |= {"parameters": len(fitted.parameters), "wall_s": time.monotonic() - began}
    version = VersionStore(twin.hand.name).get("real_closing")
    if version is None:
        raise BadInput("the version real_closing is not installed", todo="Install the package with its models")
    terms = Terms.model_validate(version.terms)
    counted = Counter(term.effect for term in terms.effects)
    effects = ", ".join(f"{count} times `{effect}`" for effect, count in counted.items())
    shipped = _row(f"`real_closing`: {effects}, and parameters", twin.changed(terms), aligned, joints)
    return [*rows, {**shipped, "parameters": len(terms.parameters) + sum(len(t.values) for t in terms.effects)}]


def _row(what: str, twin: TwinModel, aligned: Aligned, joints: tuple[str, ...]) -> dict[str, Any]:
    return {"what": what, "rad2": judged(twin, [aligned], joints)[0]}


if __name__ == "__main__":
    main()
