"""How often a law that nobody wrote is found again: right port and variables, held-out gain, seconds.

    python -m bench.proposals --half development --folder build/proposals
    python -m bench.proposals --half test --folder build/proposals-test --page docs/proposals-measured.md
    python -m bench.proposals --library --folder build/proposals-library
    python -m bench.proposals --pairs --folder build/proposals-pairs

Each case is the small arm of `foreign_laws` with one law at its elbow; with `--library` the law is an effect that the
library knows (`library_laws`), and with `--pairs` there are two laws. The verdict is given as `unexplained`, so that
the search alone is measured: it never looks into the library. Cases that are sound are measured as well: what is
proposed for them is false. The gain is held out on motion that is half again as fast. The seeds of the test half are
never used to tune. A run that was interrupted goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench.foreign_laws import LAWS, NOISE_RAD, PAIRS, arm_model, pair, record
from bench.library_laws import ANSWERS, library_model, record_pair
from bench.machine import in_words, provenance

_SEEDS = {"development": (2, 4, 6), "test": (1, 3, 5)}
_SOUND = 10
_TRAIN_S, _HELD_S = 12.0, 9.0
_TOGETHER = {law.key: law for law in (pair(LAWS[one], LAWS[other]) for one, other in PAIRS)}


def main() -> None:
    """Runs the cases that are not done yet, and prints or writes the page."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--half", choices=list(_SEEDS), default="development")
    options.add_argument("--folder", type=Path, default=Path("build/proposals"))
    options.add_argument("--library", action="store_true", help="the library's effects, taken out in turn")
    options.add_argument("--pairs", action="store_true", help="two laws at once")
    options.add_argument("--laws", nargs="*", choices=[*LAWS, *ANSWERS, *_TOGETHER])
    options.add_argument("--seeds", type=int, default=1, help="seeds a law, at most three")
    options.add_argument("--seconds", type=float, default=_TRAIN_S)
    options.add_argument("--page", type=Path)
    arguments = options.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    os.environ["TWIN_STATE_DIR"] = str((arguments.folder / "state").resolve())
    rows = []
    for key in arguments.laws or (ANSWERS if arguments.library else _TOGETHER if arguments.pairs else LAWS):
        first = _SEEDS[arguments.half]
        seeds = first[: arguments.seeds] if key != "sound" else range(first[0], first[0] + 2 * _SOUND, 2)
        for seed in seeds:
            done = arguments.folder / f"{key}_{seed}.json"
            if not done.exists():
                done.write_text(json.dumps(_case(key, seed, arguments.folder, arguments.seconds)), encoding="utf-8")
            rows.append(json.loads(done.read_text(encoding="utf-8")))
            print(_line(rows[-1]), flush=True)
    text = (
        _page(rows, arguments.half)
        + f"\n{in_words(provenance(f'python -m bench.proposals --half {arguments.half}'))}\n"
    )
    print(text)
    if arguments.page:
        arguments.page.write_text(text, encoding="utf-8")


def _case(key: str, seed: int, folder: Path, seconds: float) -> dict[str, Any]:
    from twin_daemon.diagnosis.verdict import Diagnosis
    from twin_daemon.hand import load_hand
    from twin_daemon.proposals.propose import propose
    from twin_daemon.recordings import load_recording
    from twin_daemon.simulation.alignment import align
    from twin_daemon.simulation.twin import TwinModel
    from twin_daemon.workflows.session import silence_mujoco

    silence_mujoco()
    bags = (folder / f"{key}_{seed}_fit.mcap", folder / f"{key}_{seed}_held.mcap")
    for path in bags:
        path.unlink(missing_ok=True)  # of a run that was interrupted
    if key in ANSWERS:
        model, answers = library_model(folder), ANSWERS[key]
        record_pair(key, bags, seconds=(seconds, _HELD_S), seed=seed)
    else:
        law = LAWS.get(key) or _TOGETHER[key]
        model, answers = arm_model(folder), law.answers
        record(law, bags[0], seconds=seconds, seed=seed)
        record(law, bags[1], seconds=_HELD_S, seed=100 + seed, fastest=1.5)
    twin = TwinModel.load(load_hand(model=model))
    train, held = ([align(twin, load_recording(path))] for path in bags)
    began, processor = time.perf_counter(), time.process_time()
    verdict = Diagnosis.without_findings("unexplained", "given")
    found = propose(twin, train, held, verdict, joints=["elbow"], seed=seed)
    proposal = found.proposals[0] if found.proposals else None
    said = [proposal.port, list(proposal.variables)] if proposal else None
    named = [_names(one, answers) for one in found.proposals]
    right = bool(named) and named[0]
    if key in _TOGETHER:
        right = all(any(_names(one, LAWS[own].answers) for one in found.proposals) for own in key.split("+"))
    return {
        "law": key,
        "seed": seed,
        "said": said,
        "right": right,
        "false": len(named) - sum(named),
        "beside": [f"{one.port} over {' x '.join(one.variables)}: {one.formula}" for one in found.proposals[1:]],
        "formula": proposal.formula if proposal else found.reason,
        "holdout_gain": proposal.holdout_gain if proposal else None,
        "holdout_gain_ci95": proposal.holdout_gain_ci95 if proposal else None,
        "of_true_law": _of_true_law(proposal),
        "probability": proposal.probability if proposal else None,
        "native_gain": proposal.native.holdout_gain if proposal else None,
        "tried": [row.model_dump() for row in found.tried[:6]],
        "wall_s": time.perf_counter() - began,
        "processor_s": time.process_time() - processor,
    }


def _names(proposal: Any, answers: Sequence[tuple[str, str]]) -> bool:
    """Whether a proposal has one of the ports with one of the variables that a law may be named by."""
    return any(proposal.port == port and variable in proposal.variables for port, variable in answers)


def _of_true_law(proposal: Any) -> float | None:
    """The share of what the true law takes away of the held-out error: it would leave the sensors' noise."""
    if proposal is None:
        return None
    most = 1.0 - NOISE_RAD**2 / proposal.holdout_mse_before
    return proposal.holdout_gain / most


def _line(row: dict[str, Any]) -> str:
    said = "nothing" if row["said"] is None else f"{row['said'][0]} over {' x '.join(row['said'][1])}"
    gain = "" if row["holdout_gain"] is None else f", gain {row['holdout_gain']:.3f}"
    beside = "".join(f"; {one}" for one in row["beside"])
    return f"{row['law']} ({row['seed']}): {said}{gain}, {row['processor_s']:.0f} s: {row['formula']}{beside}"


def _page(rows: list[dict[str, Any]], half: str) -> str:
    laws = [row for row in rows if row["law"] != "sound"]
    sound = [row for row in rows if row["law"] == "sound"]
    right = sum(row["right"] for row in laws)
    good = sum((row["of_true_law"] or 0.0) >= 0.8 for row in laws)
    seconds = sorted(row["processor_s"] for row in laws)
    lines = [
        "# Laws that nobody wrote: measured",
        "",
        f"The {half} half of `bench/proposals.py`: the small arm of `bench/foreign_laws.py` with one law at its elbow,",
        "parameters up to 10 % off, readings with noise of 0.5 mrad, validated on other motion, half again as fast.",
        "The verdict `unexplained` is given; the search alone is measured.",
        "",
        f"- right port and variables: {right} of {len(laws)}",
        f"- held-out gain of 80 % or more of what the true law takes away: {good} of {len(laws)}",
        f"- proposals that are none of what is there: {sum(row['false'] for row in laws)}",
        f"- proposals for sound arms: {sum(row['said'] is not None for row in sound)} of {len(sound)}",
    ]
    if seconds:
        lines.append(f"- processor time of a case: {seconds[len(seconds) // 2]:.0f} s (longest {seconds[-1]:.0f} s)")
    lines += ["", "| law | seed | said | right | held-out gain | as MJCF | formula |", "|---|---|---|---|---|---|---|"]
    for row in laws:
        said = "nothing" if row["said"] is None else f"{row['said'][0]}: {' x '.join(row['said'][1])}"
        gain = "" if row["holdout_gain"] is None else f"{row['holdout_gain']:.3f}"
        native = "" if row["native_gain"] is None else f"{row['native_gain']:.2f}"
        formula = "; ".join([row["formula"], *row["beside"]]).replace("|", "\\|")
        cells = (row["law"], row["seed"], said, "yes" if row["right"] else "no", gain, native, formula)
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
