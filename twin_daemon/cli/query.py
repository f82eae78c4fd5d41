"""`twin query`: what the daemon knows now."""

from __future__ import annotations

from datetime import UTC, datetime
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin_daemon.cli.console import emit_json, people, plain_text
from twin_daemon.cli.options import Endpoint, HandName, Json, Model, Namespace
from twin_daemon.cli.run import load_named

if TYPE_CHECKING:
    from rich.table import Table


class Question(StrEnum):
    """What can be asked."""

    state = "state"
    residual = "residual"
    version = "version"
    health = "health"
    drift = "drift"
    events = "events"
    diagnose = "diagnose"
    diagnosis = "diagnosis"
    recalibration = "recalibration"
    model = "model"


def command(
    question: Annotated[
        Question,
        typer.Argument(
            metavar="state|residual|version|health|drift|events|recalibration|model|diagnose|diagnosis",
            help="What to ask. 'diagnose' starts a diagnosis of the last minutes, 'diagnosis' reads it.",
        ),
    ] = Question.state,
    hand: HandName = None,
    model: Model = None,
    namespace: Namespace = None,
    endpoint: Endpoint = None,
    timeout: Annotated[float, typer.Option("--timeout", metavar="S", min=0.1, help="How long to wait.")] = 3.0,
    json: Json = None,
) -> int:
    """Ask the running daemon. Exit code 5 when nothing answers."""
    from bridges.zenoh.client import ask_once
    from bridges.zenoh.session import choose_endpoint

    description = load_named(hand, model, namespace).description
    answer = ask_once(choose_endpoint(endpoint), description.key(question.value), timeout)
    if json != "-":
        _show(question, answer)
    emit_json(json, answer)
    return 0


def _show(question: Question, answer: dict[str, Any]) -> None:
    console = people()
    if question is Question.state:
        console.print(state_table(answer))
    elif question is Question.residual:
        console.print(_joints(answer, "residual", ("bias_rad", "rmse_rad", "max_abs_rad", "samples")))
    elif question is Question.drift:
        console.print(_joints(answer, answer["verdict"], ("baseline_rmse_rad", "recent_rmse_rad", "ratio")))
    elif question is Question.events:
        for event in answer["events"]:
            when = datetime.fromtimestamp(event["stamp_ns"] * 1e-9, UTC).isoformat(" ", "seconds")
            console.print(f"{when}  {plain_text(event['kind'])}: {plain_text(event['text'])}")
    elif question is Question.model:
        console.print(answer["mjcf"], markup=False, soft_wrap=True)
    else:
        for name, value in _flat(answer):
            console.print(f"{plain_text(name)}: {plain_text(value)}")


def state_table(answer: dict[str, Any]) -> Table:
    """Measured beside predicted, with age and freshness, for each joint."""
    from rich.table import Table

    age = "never heard" if answer["age_s"] is None else f"last heard {answer['age_s']:.3f} s ago"
    title = f"{answer['namespace']}: {answer['status']}, {age}, version {str(answer['version'])[:12]}"
    table = Table(title=plain_text(title))
    table.add_column("joint")
    for column in ("measured rad", "predicted rad", "residual rad", "age s"):
        table.add_column(column, justify="right")
    table.add_column("data")
    for name, joint in answer["joints"].items():
        table.add_row(
            plain_text(name),
            _number(joint["measured_rad"]),
            _number(joint["predicted_rad"]),
            _number(joint["residual_rad"], "+.4f"),
            _number(joint["age_s"], ".3f"),
            "[red]stale[/red]" if joint["stale"] else "[green]fresh[/green]",
        )
    return table


def _joints(answer: dict[str, Any], title: str, columns: tuple[str, ...]) -> Table:
    from rich.table import Table

    table = Table(title=plain_text(f"{answer['namespace']}: {title}"))
    table.add_column("joint")
    for column in columns:
        table.add_column(column, justify="right")
    for name, joint in answer["joints"].items():
        table.add_row(plain_text(name), *(_number(joint[column]) for column in columns))
    return table


def _number(value: float | None, form: str = ".4f") -> str:
    if value is None:
        return "-"
    return str(value) if isinstance(value, int) else format(value, form)


def _flat(value: dict[str, Any], before: str = "") -> list[tuple[str, Any]]:
    found: list[tuple[str, Any]] = []
    for key, item in value.items():
        if isinstance(item, dict):
            found += _flat(item, f"{before}{key}.")
        elif isinstance(item, list) and item and isinstance(item[0], dict):
            found += [(f"{before}{key}", "; ".join(str(one.get("text", one)) for one in item))]
        else:
            found.append((f"{before}{key}", "-" if item is None else item))
    return found
