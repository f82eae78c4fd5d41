"""The page of all benchmarks, from their results and from nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bench.machine import in_words

_LONG = {
    "python -m bench.dissertation": "the tables of a dissertation rebuilt ([page](dissertation.md)); half an hour",
    "make suite": "the diagnosis of robots drawn at random with hidden effects, a sample of 40 of 400 cases "
    "([page](hidden-suite.md)); an hour",
    "python -m bench.home_suite": "the diagnosis of 80 hidden cases of the Shadow Hand ([page](home-suite.md)); "
    "an hour",
    "python -m bench.law_errors": "how far each law of the library is off the same law written apart, at the same "
    "values; five minutes",
    "python -m bench.whole_hand": "how long a diagnosis of the whole hand takes, and whether it is right; four minutes",
    "python -m bench.live --realtime": "ten minutes of the daemon at 1 kHz beside a bare echo",
    "python -m bench.hot_path": "what one joint state costs the daemon, stage by stage",
    "python -m bench.hot_swap": "promotions under a daemon at 1 kHz",
    "python -m bench.drift": "hours without wear, and wear: false alarms, and time until it is named",
    "python -m bench.gate_streams": "what the gate lets through, against what it should",
    "python -m bench.gate_kills": "processes killed while a motion runs through the gate",
    "python -m bench.store_kill": "writers of the store of versions killed",
    "python -m bench.conditions": "the diagnosis with another plant, worse sensors, less time; the time of each "
    "candidate ([page](conditions.md)); a quarter of an hour",
    "python -m bench.poor_motion": "what a diagnosis says where the motion shows little ([page](poor-motion.md))",
    "python -m bench.closing_laws": (
        "what the real hand's closing leaves: laws fitted to one half of it, judged on the other "
        "([page](proposals.md#on-the-real-hands-closing))"
    ),
    "python -m bench.wear": "recalibration of a hand that wears",
    "python -m bench.wear_named": (
        "weeks of wear drawn at random: when each is named, and what is named wrongly ([page](wear-named.md))"
    ),
    "python -m bench.workbench": "how fast the workbench answers",
    "make fuzz": "100 000 hostile inputs",
}
"""Proofs that take longer, or that are no comparison: commands of their own."""

_HEAD = """# Benchmarks

Made by `make bench`; [bench.json](bench.json) holds the same numbers for programs. Each row compares two things that
were measured in turn, in one run on one machine; the ratio is ours over theirs, and the spread is its least and its
greatest value over the rounds. Only ratios mean something on another machine. A goal that is not reached says so.
Roll-outs use all cores; the matrix library has one thread, for peers as well.

```sh
make bench                                    # minutes; rewrites this page
python -m bench --quick                       # one round of each, and no page
python -m bench --only sysid                  # one of them; the others keep their numbers
python -m bench --against docs/bench.json     # ratios whose spread does not meet that of an earlier run
```
"""


def page(results: Mapping[str, Mapping[str, Any]]) -> str:
    """Markdown of all results."""
    out = [_HEAD, *(_section(result) for result in results.values()), "## Longer proofs\n"]
    out += ["| command | what it measures |", "|---|---|"]
    out += [f"| `{command}` | {what} |" for command, what in _LONG.items()]
    return "\n".join(out) + "\n"


def _section(result: Mapping[str, Any]) -> str:
    out = [f"## {result['name']}", "", f"{result['compares']}", ""]
    if result["left_out"]:
        out += [f"Left out: {result['left_out']}.", ""]
    else:
        out += ["| what | ours | theirs | ratio | spread | goal |", "|---|---|---|---|---|---|"]
        out += [row_text(row) for row in result["rows"]] + [""]
        out += [f"- {row['what']}: {row['note']}" for row in result["rows"] if row["note"]]
        out += [""] if any(row["note"] for row in result["rows"]) else []
    if result["reading"]:
        out += [result["reading"], ""]
    out += [in_words(result), ""]
    return "\n".join(out)


def row_text(row: Mapping[str, Any]) -> str:
    """A row as it stands in a table."""
    unit, goal = row["unit"], row["goal"]
    if row["met"] is not None:
        goal += ": reached" if row["met"] else ": **not reached**"
    spread = "" if row["spread"] is None else " to ".join(_number(value) for value in row["spread"])
    cells = [
        row["what"],
        _value(row["ours"], unit),
        _value(row["theirs"], unit),
        _number(row["ratio"], 4),
        spread,
        goal,
    ]
    return "| " + " | ".join(cells) + " |"


def _value(value: float | None, unit: str) -> str:
    return "" if value is None else f"{_number(value)} {unit}".rstrip()


def _number(value: float | None, digits: int = 3) -> str:
    return "" if value is None else f"{value:.{digits}g}"
