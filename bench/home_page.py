"""What the home suite came to: rates beside their goals, a confusion matrix with counts, and every case."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench.home_cases import Case, planted
from twin_daemon.plant import Hidden

_INTRODUCTION = (
    "# The home suite",
    "",
    "Made by `python -m bench.home_suite`: 80 plants of the Shadow Hand, which the diagnosis was built for; robots",
    "drawn at random are in the [hidden suite](hidden-suite.md). Every plant has parameters up to 20 % off the",
    "nominal ones, its own integrator and step, quantised and noisy sensors and stamps that jitter; 16 s of motion of",
    "one finger to fit, 8 s of other motion held out. `within_noise` counts as wrong where something was hidden,",
    "however mild.",
)

_GOALS = {
    "single: the right name first": 0.95,
    "none: within_noise": 0.95,
    "foreign: unexplained": 0.95,
    "pair: both named": 0.90,
    "poor: not a wrong name explained": 0.98,
}


def page(chosen: Sequence[Case], folder: Path, of: int | None = None) -> str:
    """The whole page as Markdown. Cases without a diagnosis count as failed; `of` is how many cases there are."""
    rows = [outcome(case, folder) for case in chosen]
    sample = [] if of in (None, len(rows)) else ["", f"{len(rows)} of {of} cases were run, a random sample."]
    out = [*_INTRODUCTION, *sample, "", "| what | goal | reached | of |", "|---|---|---|---|"]
    for name, goal in _GOALS.items():
        kind = name.partition(":")[0]
        mine = [row for row in rows if row["kind"] == kind]
        if mine:
            good = sum(row["right"] for row in mine)
            out.append(_share(name, f"{goal:.0%}", good, len(mine)))
            if kind == "pair":
                beside = sum(row["beside"] for row in mine)
                out.append(_share("pair: both named, or what a name cannot be told from", "-", beside, len(mine)))
    wrong = [row for row in rows if row["verdict"] == "explained" and row["wrong_name"]]
    out.append(_share("all: `explained` with a wrong name", "at most 2 %", len(wrong), len(rows)))
    covered = [inside for row in rows for inside in row["covered"]]
    if covered:
        out.append(_share("planted value inside its 95 % interval", "90 to 98 %", sum(covered), len(covered)))
    seconds = sorted(row["wall_s"] for row in rows)
    out += ["", f"Seconds a case on one core: median {seconds[len(seconds) // 2]:.0f}, longest {seconds[-1]:.0f}.", ""]
    out += [
        "## Confusion",
        "",
        "Rows: what was hidden. Columns: what was named first, or the verdict without a name.",
        "",
    ]
    out += _matrix(rows)
    out += [
        "",
        "## Every case",
        "",
        "| hidden | verdict | named | planted, found (95 %) | s |",
        "|---|---|---|---|---|",
    ]
    for row in rows:
        mark = "" if row["right"] else " ✗"
        out.append(
            f"| {row['hidden']}{mark} | {row['verdict']} | {row['named']} | {row['value']} | {row['wall_s']:.0f} |"
        )
    return "\n".join(out) + "\n"


def _share(what: str, goal: str, count: int, total: int) -> str:
    return f"| {what} | {goal} | {100.0 * count / total:.3g}% | {count} of {total} |"


def outcome(case: Case, folder: Path) -> dict[str, Any]:
    """What was hidden in a case, what was said of it, and whether that is right."""
    answers = [Hidden(a["key"], a["joint"], a["value"]) for a in _read(folder / "answers" / f"{case.name}.json", [])]
    said = _read(folder / f"{case.name}.json", {"verdict": "failed", "findings": [], "wall_s": 0.0})
    findings, verdict = said["findings"], said["verdict"]
    hits = [next((f for f in findings if _same(f, hidden)), None) for hidden in answers]
    first = findings[0] if findings else None
    beside = False
    if case.kind == "none":
        right = verdict == "within_noise"
    elif case.kind == "foreign":
        right = verdict == "unexplained"
    elif case.kind == "single":
        right = first is not None and _same(first, answers[0]) and verdict in ("explained", "ambiguous")
    elif case.kind == "pair":
        right = all(hit is not None for hit in hits)
        told = {f"{h.key}:{h.joint}" for h, hit in zip(answers, hits, strict=True) if hit is None}
        beside = told <= {name for f in findings for name in f.get("confusable_with", [])}
    else:
        right = not (verdict == "explained" and not (first and _same(first, answers[0])))
    wrong_name = any(not any(_same(f, hidden) for hidden in answers) for f in findings)
    covered, value = _coverage(answers, hits)
    return {
        "kind": case.kind,
        "hidden": " + ".join(f"{h.key}:{h.joint or 'hand'}" for h in answers) or "nothing",
        "key": answers[0].key if case.kind in ("single", "poor", "foreign") else case.kind,
        "verdict": verdict,
        "named": ", ".join(f"{f['effect']}:{(f['joints'] or ['hand'])[0]}" for f in findings),
        "first": first["effect"] if first and verdict in ("explained", "ambiguous") else verdict,
        "right": bool(right),
        "beside": beside,
        "wrong_name": wrong_name,
        "covered": covered,
        "value": value,
        "wall_s": float(said.get("wall_s") or 0.0),
    }


def _read(path: Path, otherwise: Any) -> Any:
    return json.loads(path.read_text()) if path.exists() else otherwise


def _same(finding: dict[str, Any], hidden: Hidden) -> bool:
    return finding["effect"] == hidden.key and (hidden.joint is None or hidden.joint in finding["joints"])


def _coverage(answers: Sequence[Hidden], hits: Sequence[dict[str, Any] | None]) -> tuple[list[bool], str]:
    """(whether each planted value that was found is inside its interval, the values in words)."""
    covered, words = [], []
    for hidden, hit in zip(answers, hits, strict=True):
        expected = planted(hidden)
        if hit is not None and expected is not None and expected[0] in hit["parameters"]:
            found = hit["parameters"][expected[0]]
            low, high = found["ci95"]
            covered.append(bool(low <= expected[1] <= high))
            words.append(f"{expected[0]} {expected[1]:.3g}: {found['value']:.3g} ({low:.3g} to {high:.3g})")
    return covered, "; ".join(words)


def _matrix(rows: Sequence[dict[str, Any]]) -> list[str]:
    counts = Counter((row["key"], row["first"]) for row in rows if row["kind"] != "pair")
    columns = sorted({first for _, first in counts})
    out = ["| |" + "|".join(columns) + "|", "|---" * (len(columns) + 1) + "|"]
    for key in sorted({key for key, _ in counts}):
        out.append(f"| {key} |" + "|".join(str(counts[key, c]) if counts[key, c] else "" for c in columns) + "|")
    return out
