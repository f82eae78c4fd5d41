"""The page about the dissertation, from the measured results and from what it reports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Reported:
    """What the dissertation reports of one space: its start and its errors by search, rad^2."""

    title: str
    table: str
    motion: str
    start_rad2: float
    errors: dict[str, float] = field(default_factory=dict)
    groups: tuple[str, ...] = ()

    @property
    def best_rad2(self) -> float:
        return min(self.errors.values())


SPACES = {
    "first-approach": Reported(
        "First approach", "5.2", "hand_closing", 0.056890,
        {"random": 0.008471, "pso": 0.008024, "bayes": 0.008416}, ("FJ1", "FJ2"),
    ),
    "second-approach": Reported(
        "Second approach", "5.3", "hand_closing", 0.056890,
        {"random": 0.006967, "pso": 0.006712, "bayes": 0.006277}, ("FJ1", "FJ2", "FJ3"),
    ),
    "thumb": Reported("Thumb", "5.5", "thumb_calibration", 0.001514, {"bayes": 0.000289}),
}  # fmt: skip

_NAMES = {
    "random": "random, 1000 points",
    "pso": "particle swarm, 10 x 100",
    "bayes": "Bayesian (Gaussian process)",
    "least-squares": "least squares (`twin calibrate`)",
}

_HEAD = """# The dissertation, rebuilt

T. Correia (FEUP 2023) fitted a Shadow Hand's parameters with random search, a particle swarm and Bayesian search, in
500 to 1000 runs of about four hours in all. Here are the same spaces, bounds and recordings, with this project's
model and roll-outs, fitted on the whole recording as there; nothing is held out, so these are errors of fit.

Made by `python -m bench.dissertation`; [dissertation.json](dissertation.json) holds the numbers. Errors are mean
squared position errors in rad² over the joints of the table, the onset of the command estimated for every model alike.

## What could not be rebuilt, and what was assumed

- Its actuators are not public. Here they are this project's: position servos with the gains of `models/shadow_hand`.
  So the two starts differ: the same stiffness, spring, friction and damping, but not the same error. A lower error
  here is therefore no proof of a better search; the searches of one table here can be compared with each other.
- Its simulation ran in real time beside ROS and matched samples by the nearest stamp. Here the command begins where
  it fits the roll-out best, and the prediction is interpolated. The raw command and the nominal model get the
  same right.
- Its bounds reach below zero at the thumb (200 %). Here friction and damping end at what exists.
- Fingers share one value a joint class, since the tables speak of FJ1, FJ2 and FJ3.
- Recordings that it did not publish (repetitions, other speeds) are not here: what follows speaks of one motion each.
"""


def page(result: Mapping[str, Any]) -> str:
    """Markdown of all results."""
    out = [_HEAD]
    for name, reported in SPACES.items():
        out += _table(name, reported, result["spaces"][name])
    out += _beyond(result)
    out += _bounds(result)
    out += _damping(result["damping"])
    packages = ", ".join(f"{name} {version}" for name, version in result["versions"].items())
    out += [
        "## How it was measured",
        "",
        f"`{result['command']}`; {result['date']}, commit {result['commit'] or 'unknown'}; {result['machine']}; "
        f"{packages}.",
    ]
    return "\n".join(out) + "\n"


def _table(name: str, reported: Reported, space: Mapping[str, Any]) -> list[str]:
    out = [f"## {reported.title} (table {reported.table})", ""]
    out += [
        f"{space['parameters']} parameters over {len(space['joints'])} joints. The space's start scores "
        f"{space['start_rad2']:.3g} here and {reported.start_rad2:.4g} there; the nominal model "
        f"{space['nominal_rad2']:.3g}, the raw command {space['raw_command_rad2']:.3g}.",
        "",
    ]
    heads = ["search", "evaluations", "time", "error", "reduction", *reported.groups, "on bounds", "there: error",
             "reduction"]  # fmt: skip
    out += ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for search, found in space["searches"].items():
        theirs = reported.errors.get(search)
        cells = [
            _NAMES[search],
            str(found["evaluations"]),
            f"{found['wall_s']:.0f} s",
            f"{found['rad2']:.3g}",
            f"{1.0 - found['rad2'] / space['start_rad2']:.1%}",
            *(f"{found['by_group'][group]:.2g}" for group in reported.groups),
            f"{len(found['at_bound'])} of {space['parameters']}",
            f"{theirs:.4g}" if theirs else "",
            f"{1.0 - theirs / reported.start_rad2:.1%}" if theirs else "",
        ]
        out.append("| " + " | ".join(cells) + " |")
    calls = space["searches"]["bayes"]["evaluations"]
    if calls < 500:
        out += ["", f"The Gaussian process asked {calls} times instead of 500: then its time was over."]
    return [*out, "", f"![best error by evaluation](pictures/dissertation-{name}.svg)", ""]


def _beyond(result: Mapping[str, Any]) -> list[str]:
    second = result["spaces"]["second-approach"]
    found = second["searches"]["least-squares"]
    out = [
        "## Beyond its spaces",
        "",
        "The closing again, over the joints of the second approach.",
        "",
        "| model | parameters | error | of the dissertation's best |",
        "|---|---|---|---|",
    ]
    best = SPACES["second-approach"].best_rad2
    rows = [
        {"what": "raw command", "rad2": second["raw_command_rad2"], "parameters": 0},
        {"what": "second approach, least squares", "rad2": found["rad2"], "parameters": second["parameters"]},
        *result["beyond"],
    ]
    out += [f"| {r['what']} | {r['parameters']} | {r['rad2']:.3g} | {r['rad2'] / best:.2g} |" for r in rows]
    return [
        *out,
        "",
        "`real_closing` was fitted before, by `twin ladder` on this recording, and is only scored here; it comes "
        "with the program. "
        "Its parameters count the values of its effects, too.",
        "What its error fell by is a mechanism and not a better number: the tendon of a finger splits its travel "
        "unevenly "
        "between the middle and the distal joint ([coupling.md](coupling.md)).",
        "",
    ]


def _bounds(result: Mapping[str, Any]) -> list[str]:
    out = [
        "## Optima on the bounds",
        "",
        "A value on its bound is one that the search would have taken further: the box limits the result, not the "
        "optimiser.",
        "",
        "| space | search | on a bound |",
        "|---|---|---|",
    ]
    for name, space in result["spaces"].items():
        for search, found in space["searches"].items():
            where = ", ".join(found["at_bound"]) or "none"
            out.append(f"| {name} | {_NAMES[search]} | {where} |")
    words = result["spaces"]["second-approach"]["searches"]["least-squares"]["identifiability"]
    counted = ", ".join(f"{count} {word.replace('_', ' ')}" for word, count in sorted(words.items()))
    return [
        *out,
        "",
        "The model lacks the uneven split of a finger's travel between J1 and J2. Springs, friction and the ends of "
        "the "
        "ranges are what these spaces have to imitate it with, and they go as far as they may. How little they are "
        "determined shows in the intervals of least squares: "
        f"of the second approach's values, {counted}.",
        "",
    ]


def _damping(points: list[Mapping[str, Any]]) -> list[str]:
    out = [
        "## Negative damping",
        "",
        "The dissertation's thumb has negative damping and friction. MuJoCo compiles both without a word; such a "
        "joint feeds energy "
        "into its own motion. The thumb's error here with one damping at all of its joints, and the command's onset "
        "as it suits that "
        "damping, as it suits the raw command, and 20 ms later than that:",
        "",
        "| damping, N m s/rad | its own onset | the raw command's | 20 ms late |",
        "|---|---|---|---|",
    ]
    columns = ("anew_rad2", "held_rad2", "late_rad2")
    for p in points:
        errors = ["diverges" if p[column] is None else f"{p[column]:.3g}" for column in columns]
        out.append(f"| {p['damping']:.3g} | " + " | ".join(errors) + " |")
    best = [min((p for p in points if p[c] is not None), key=lambda p: p[c])["damping"] for c in columns]
    return [
        *out,
        "",
        f"The best damping is {best[0]:.3g}, {best[1]:.3g} and {best[2]:.3g} N m s/rad. Damping against a position "
        "servo is a lag of damping "
        "over gain; the later the command, the less of it the error wants, down to where the joint shakes by itself. "
        "So a "
        "negative damping can make up for a command that comes too late. Whether this is what happened there cannot "
        "be told "
        "without its actuators. This project estimates the onset where a recording does not hold its commands, and "
        "refuses values "
        "that cannot exist.",
        "",
    ]
