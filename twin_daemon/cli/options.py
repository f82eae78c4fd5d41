"""Options that several commands share, so that they are spelled and explained once.

Use them as annotations: `def command(recording: Recordings, hand: HandName = None, json: Json = None) -> None`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from twin_daemon.errors import UsageError

HandName = Annotated[
    str | None,
    typer.Option("--hand", metavar="NAME|PATH", help="Hand description: a name in models/ or a YAML file."),
]
Model = Annotated[
    Path | None,
    typer.Option("--model", metavar="FILE.xml", help="Any MJCF whose joints bear the names in the data."),
]
Endpoint = Annotated[
    str | None,
    typer.Option("--endpoint", metavar="ENDPOINT", help="Zenoh endpoint; default TWIN_ENDPOINT or tcp/127.0.0.1:7447."),
]
Namespace = Annotated[
    str | None, typer.Option("--namespace", metavar="NS", help="First part of the keys; default the hand's name.")
]
Config = Annotated[Path | None, typer.Option("--config", "-c", metavar="twin.yaml", help="Configuration.")]
As = Annotated[
    str,
    typer.Option("--as", metavar="NAME", help="Which identity of the key file asks (TWIN_KEYS names another file)."),
]
Reason = Annotated[str, typer.Option("--reason", metavar="TEXT", help="Why, for the audit log.")]
_RECORDING = typer.Option("--recording", metavar="R...", help="Recordings: ROS 1 or 2 bags, MCAP, CSV.")
Recordings = Annotated[list[Path], _RECORDING]
OptionalRecordings = Annotated[list[Path] | None, _RECORDING]
Holdouts = Annotated[
    list[Path] | None,
    typer.Option("--holdout", metavar="R...", help="Validation data: recordings that the fit never sees."),
]
JointMap = Annotated[
    Path | None,
    typer.Option("--joint-map", metavar="FILE", help="YAML that renames joints of the data: {name in data: name}."),
]
TrajectoryRef = Annotated[
    str | None,
    typer.Option(
        "--trajectory", metavar="FILE.yaml:NAME", help="What was commanded, where the recording has no commands."
    ),
]
VersionRef = Annotated[
    str | None,
    typer.Option("--version", metavar="V", help="Version: id, start of an id, name, current, candidate or previous."),
]
Terms = Annotated[
    Path | None,
    typer.Option("--terms", metavar="FILE", help="Parameters and effects from a file instead of a stored version."),
]
Joints = Annotated[
    list[str] | None,
    typer.Option("--joints", metavar="J...", help="Only these joints."),
]
_EFFECT = typer.Argument(metavar="EFFECT", help="A key of the library: twin effects lists them.")
EffectKey = Annotated[str, _EFFECT]
OptionalEffectKey = Annotated[str | None, _EFFECT]
_JOINT = typer.Option("--joint", metavar="J...", help="Joints that the effect acts on.")
JointNames = Annotated[list[str], _JOINT]
OptionalJointNames = Annotated[list[str] | None, _JOINT]
FindingRef = Annotated[
    str | None,
    typer.Option(
        "--finding",
        metavar="FILE[:N]",
        help="Take over the Nth finding of a diagnosis (twin diagnose --json FILE) instead of fitting anew.",
    ),
]
Bind = Annotated[
    str, typer.Option("--bind", metavar="ADDRESS", help="Address to listen at; others than loopback are reachable.")
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="name=value...", help="Values of the effect's parameters; the others are fitted."),
]
Space = Annotated[
    str | None,
    typer.Option("--space", metavar="NAME|FILE", help="Which parameters may move, and how far."),
]
Budget = Annotated[
    int | None,
    typer.Option("--budget", metavar="N", min=1, help="Largest number of simulations."),
]
Seed = Annotated[int, typer.Option("--seed", metavar="N", help="Same seed, same result.")]
Seconds = Annotated[
    float | None,
    typer.Option("--seconds", metavar="S", min=0.0, help="End by itself after this long."),
]
Cluster = Annotated[
    str | None,
    typer.Option("--cluster", metavar="tcp://HOST:PORT", help="Work on this Dask cluster (extra 'cluster')."),
]
Output = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="PATH", help="Where to write the result."),
]
Json = Annotated[
    str | None,
    typer.Option("--json", metavar="PATH", help="Write the result as one JSON object ('-' is standard output)."),
]


def settings(pairs: list[str] | None) -> dict[str, float]:
    """`["breakaway=0.02"]` -> {"breakaway": 0.02}."""
    values: dict[str, float] = {}
    for pair in pairs or []:
        name, equals, value = pair.partition("=")
        try:
            number = float(value)
        except ValueError:
            number = None
        if not (name and equals) or number is None:
            raise UsageError(f"'{pair}' is not name=value", where="--set", todo="Write --set breakaway=0.02")
        values[name] = number
    return values
