"""The page of the hidden suite: rates with their intervals beside the goals, what decides them, and every case."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import beta

from bench.random_robots.score import CERTAIN, is_cause, outcome, same

_BINS = (1.5, 3.0, 6.0, 12.0, 31.0)
_CLAIMED = (0.0, 0.5, 0.8, 0.95, 0.99, 1.0)
_NOT_COMPARED = {"payload"}
"""Effects whose planted number is no parameter of the library's: a load that is not quite at the end of its link."""

_ABOUT = """# The hidden suite

Robots drawn at random: fingers, hands with wrists and coupled tendons, arms, gantries, with their own noise, rate,
integrator, time step, jitter and delay; the nominal model's masses, centres and inertias are off by up to 5 % (in a
fifth of the cases by nothing, in a seventh also damping and friction by 10 % and servos by 5 %); everything moves.
Plants and laws are written apart from the library ([format](suite-format.md)). The strength of an effect is its rms
response at its joint over the floor there: what sensors leave, and what the nominal model itself lacks.

Half: {half}. {done} of {planned} cases have run, on commit {commits}. Intervals are those of Clopper and Pearson, 95 %.
Beside it stands the plain baseline on the same cases: each effect at each place fitted alone by least squares with
nominal parameters, the lowest held-out error wins (`python -m bench.plain_baseline`).
"""

Result = dict[str, Any]
Question = tuple[str, str, Callable[[Result], bool]]


def _kind(*kinds: str) -> Callable[[Result], bool]:
    return lambda one: one["truth"]["kind"] in kinds


_QUESTIONS: tuple[Question, ...] = (
    ("one effect, 3 times the floor or more: right name first, `explained` or a tie", ">= 90 %, lower bound >= 85 %",
     lambda one: one["truth"]["kind"] == "single" and one["truth"]["strength"] >= CERTAIN),
    ("one effect, 1.5 to 3 times the floor", "-",
     lambda one: one["truth"]["kind"] == "single" and one["truth"]["strength"] < CERTAIN),
    ("nothing hidden: `within_noise`", ">= 97 %", _kind("nothing")),
    ("a law of no library: `unexplained`", ">= 95 %", _kind("foreign")),
    ("a cause of the whole robot: named once, for the robot", ">= 95 %", _kind("robot")),
    ("two effects: both named", ">= 85 %", _kind("pair")),
)  # fmt: skip


def page(results: Sequence[Result], planned: int, half: str) -> str:
    """Markdown of what came out; `planned` is how many cases there should be."""
    for one in results:
        one["ours"] = outcome(one["truth"], one["said"])
        one["theirs"] = outcome(one["truth"], one["plain"]) if "plain" in one else None
    commits = ", ".join(sorted({str(one["said"].get("commit")) for one in results})) or "-"
    about = _ABOUT.format(half=half, done=len(results), planned=planned, commits=commits)
    out = [about, "| what | goal | reached | of | 95 % interval | plain baseline |", "|---" * 6 + "|"]
    for what, goal, asked in _QUESTIONS:
        mine = [one for one in results if asked(one)]
        out.append(_row(what, goal, mine, "right"))
    out.append(_row("all: `explained` with a wrong name", "<= 2 %", results, "sure_and_wrong"))
    out += ["", *_seconds(results), "", "## Planted values", "", *_values(results)]
    out += ["", "## Probabilities", "", *_reliability(results)]
    out += ["", "## Power against strength", "", *_power(results)]
    out += ["", "## By robot", "", *_groups(results, lambda one: one["truth"]["robot"]["kind"])]
    out += ["", "## By what was hidden", "", *_groups(results, _hidden_key)]
    out += ["", "## Confusion", "", "Rows: what was hidden. Columns: what was named first, or the verdict.", ""]
    out += [*_matrix(results), "", "## Every case", "", *_every(results)]
    return "\n".join(out) + "\n"


def clopper_pearson(count: int, total: int, level: float = 0.95) -> tuple[float, float]:
    """The exact interval of a share, `count` of `total`."""
    tail = (1 - level) / 2
    low = float(beta.ppf(tail, count, total - count + 1)) if count else 0.0
    high = float(beta.ppf(1 - tail, count + 1, total - count)) if count < total else 1.0
    return low, high


def _row(what: str, goal: str, mine: Sequence[Result], which: str) -> str:
    if not mine:
        return f"| {what} | {goal} | - | 0 | - | - |"
    count = sum(one["ours"][which] for one in mine)
    low, high = clopper_pearson(count, len(mine))
    share = f"{count / len(mine):.1%} | {count} of {len(mine)} | {low:.1%} to {high:.1%}"
    return f"| {what} | {goal} | {share} | {_plain(mine, which)} |"


def _plain(mine: Sequence[Result], which: str) -> str:
    judged = [one["theirs"][which] for one in mine if one["theirs"]]
    return f"{sum(judged) / len(judged):.1%} ({sum(judged)} of {len(judged)})" if judged else "-"


def _seconds(results: Sequence[Result]) -> list[str]:
    """Seconds of the processor by kind of case: median, ninth decile, longest; memory."""
    out = [
        "| seconds of one core | ours: median | 90 % | longest | memory, largest | plain: median |",
        "|---" * 6 + "|",
    ]
    for kind in ("nothing", "single", "robot", "foreign", "pair"):
        mine = [one for one in results if one["truth"]["kind"] == kind]
        if mine:
            took = np.array([one["said"]["processor_s"] for one in mine])
            memory = max(one["said"]["memory_mb"] for one in mine)
            plain = [one["plain"]["processor_s"] for one in mine if "plain" in one]
            theirs = f"{np.median(plain):.0f}" if plain else "-"
            middle, most = np.quantile(took, (0.5, 0.9))
            out.append(f"| {kind} | {middle:.0f} | {most:.0f} | {took.max():.0f} | {memory:.0f} MB | {theirs} |")
    failed = [one for one in results if one["said"]["verdict"] == "failed"]
    if failed:
        late = sum("not ended" in one["said"].get("why", "") for one in failed)
        out += ["", f"{len(failed)} ended without an answer, {late} of them by the time limit; they count as wrong."]
    return out


def _values(results: Sequence[Result]) -> list[str]:
    """How far found values are from planted ones, in parts of their own sigma, where the effect was named."""
    found = []
    for one in results:
        for hidden in one["truth"]["effects"]:
            hit = next((f for f in one["said"]["findings"] if same(f, hidden)), None)
            if hit is None or hidden["effect"] in _NOT_COMPARED or hidden["scope"] == "robot":
                continue
            for name, planted in hidden["parameters"].items():
                said = hit["parameters"].get(name)
                if said and said.get("ci95") and None not in (*said["ci95"], said["value"]):
                    low, high = said["ci95"]
                    sigma = max((high - low) / 3.92, 1e-12)
                    z = abs(planted - said["value"]) / sigma
                    found.append(
                        (z, low <= planted <= high, one["truth"]["case"], hidden["effect"], name, planted, said)
                    )
    if not found:
        return ["No hidden effect with a number was named."]
    sizes = np.array([row[0] for row in found])
    inside = sum(row[1] for row in found)
    out = [
        f"{inside} of {len(found)} values lie in their 95 % interval ({inside / len(found):.0%}; goal 92 to 98 %).",
        f"Median of |z| {np.median(sizes):.2f} (right: 0.67), 90 % below {np.quantile(sizes, 0.9):.1f}.",
        "Farthest off:", "", "| case | value | planted | found (95 %) | abs z |", "|---|---|---|---|---|",
    ]  # fmt: skip
    for z, _, case, effect, name, planted, said in sorted(found, key=lambda row: -row[0])[:5]:
        low, high = said["ci95"]
        out.append(
            f"| {case} | {effect} {name} | {planted:.3g} | {said['value']:.3g} ({low:.3g} to {high:.3g}) | {z:.1f} |"
        )
    return out


def _reliability(results: Sequence[Result]) -> list[str]:
    """How often the set of causes that was held most probable is the right one, against its probability."""
    said = [(one["said"]["probabilities"][0], one["truth"]) for one in results if one["said"].get("probabilities")]
    if not said:
        return ["No case has probabilities."]
    claimed = np.array([first["probability"] for first, _ in said])
    right = np.array([is_cause(first["effects"], truth) for first, truth in said])
    out = ["| probability of the first | of | right | mean probability |", "|---" * 4 + "|"]
    error = 0.0
    for low, high in pairwise(_CLAIMED):
        inside = (claimed > low) & (claimed <= high)
        if inside.any():
            share, mean = right[inside].mean(), claimed[inside].mean()
            error += inside.mean() * abs(share - mean)
            out.append(f"| {low:g} to {high:g} | {inside.sum()} | {share:.0%} | {mean:.2f} |")
    return [*out, "", f"Expected calibration error {error:.3f} (goal 0.05), of {len(said)} answers."]


def _power(results: Sequence[Result]) -> list[str]:
    """The share of single and robot-wide effects that are named, against their strength."""
    out = ["| error over the floor | of | right | 95 % interval | wrong name, sure | plain: right |", "|---" * 6 + "|"]
    named = [one for one in results if one["truth"]["kind"] in ("single", "robot")]
    for low, high in pairwise(_BINS):
        mine = [one for one in named if low <= one["truth"]["strength"] < high]
        if mine:
            right = sum(one["ours"]["right"] for one in mine)
            wrong = sum(one["ours"]["sure_and_wrong"] for one in mine)
            least, most = clopper_pearson(right, len(mine))
            reach = f"{least:.0%} to {most:.0%} | {wrong} | {_plain(mine, 'right')}"
            out.append(f"| {low:g} to {min(high, 30):g} | {len(mine)} | {right / len(mine):.0%} | {reach} |")
    return out


def _groups(results: Sequence[Result], group: Callable[[Result], str]) -> list[str]:
    out = ["| | of | right | wrong name, sure | plain: right |", "|---|---|---|---|---|"]
    for name in sorted({group(one) for one in results}):
        mine = [one for one in results if group(one) == name]
        right = sum(one["ours"]["right"] for one in mine)
        wrong = sum(one["ours"]["sure_and_wrong"] for one in mine)
        out.append(f"| {name} | {len(mine)} | {right} ({right / len(mine):.0%}) | {wrong} | {_plain(mine, 'right')} |")
    return out


def _hidden_key(one: Result) -> str:
    truth = one["truth"]
    if truth["kind"] in ("nothing", "pair"):
        return str(truth["kind"])
    return truth["effects"][0]["effect"] + (" (robot)" if truth["kind"] == "robot" else "")


def _first(one: Result) -> str:
    found, verdict = one["said"]["findings"], one["said"]["verdict"]
    return str(found[0]["effect"]) if found and verdict in ("explained", "ambiguous") else str(verdict)


def _matrix(results: Sequence[Result]) -> list[str]:
    counts = Counter((_hidden_key(one), _first(one)) for one in results if one["truth"]["kind"] != "pair")
    columns = sorted({first for _, first in counts})
    if not columns:
        return ["No case has run."]
    out = ["| |" + "|".join(columns) + "|", "|---" * (len(columns) + 1) + "|"]
    for key in sorted({key for key, _ in counts}):
        out.append(f"| {key} |" + "|".join(str(counts[key, c]) if counts[key, c] else "" for c in columns) + "|")
    return out


def _every(results: Sequence[Result]) -> list[str]:
    out = ["| case | robot | hidden (over the floor) | verdict | named | s | plain |", "|---" * 7 + "|"]
    for one in results:
        truth, said = one["truth"], one["said"]
        robot = f"{truth['robot']['kind']}, {truth['robot']['joints']} joints, {truth['robot']['rate_hz']:.0f} Hz"
        hidden = " + ".join(
            f"{e['effect']}:{'robot' if e['scope'] == 'robot' else e['joints'][0]} ({e['strength']:.1f})"
            for e in truth["effects"]
        )
        mark = "" if one["ours"]["right"] else " ✗"
        out.append(
            f"| {truth['case']}{mark} | {robot} | {hidden or 'nothing'} | {said['verdict']} | {_named(said)} |"
            f" {said['processor_s']:.0f} | {_named(one['plain']) if 'plain' in one else ''} |"
        )
    return out


def _named(said: dict[str, Any]) -> str:
    return ", ".join(f"{f['effect']}:{(f['joints'] or ['robot'])[0]}" for f in said["findings"]) or "-"
