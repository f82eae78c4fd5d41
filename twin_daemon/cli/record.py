"""`twin record`: what is on Zenoh, as one MCAP file."""

from __future__ import annotations

import time
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin_daemon.cli.console import emit_json, people, plain_text
from twin_daemon.cli.options import Endpoint, HandName, Json, Model, Namespace, Seconds
from twin_daemon.cli.run import load_named
from twin_daemon.errors import BadInput, NoAnswer, UsageError
from twin_daemon.workflows.progress import progress_console

if TYPE_CHECKING:
    from twin_daemon.hand import HandDescription
    from twin_daemon.services.recorder import Recorded
    from twin_daemon.services.stop import Stoppable

_TURN_S = 1.0  # between two progress lines
_KEEP_TIMEOUT_S = 60.0  # the daemon writes gently


def command(
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE.mcap", help="Default: hand and UTC time, in this folder."),
    ] = None,
    seconds: Seconds = None,
    keep: Annotated[
        bool, typer.Option("--keep", help="Let the daemon save its last minutes instead, and print the path.")
    ] = False,
    recover: Annotated[
        Path | None,
        typer.Option("--recover", metavar="FILE.mcap.part", help="Bring back what a killed recorder had written."),
    ] = None,
    hand: HandName = None,
    model: Model = None,
    namespace: Namespace = None,
    endpoint: Endpoint = None,
    json: Json = None,
) -> int:
    """Record measured, commanded, predicted and residual joints until Ctrl-C. Exit code 5 when nothing arrives."""
    from bridges.zenoh.session import choose_endpoint

    if keep and (output or seconds is not None or recover):
        raise UsageError("--keep goes with no --output, --seconds or --recover", todo="The daemon chooses the place")
    if recover and seconds is not None:
        raise UsageError("--recover goes with no --seconds")
    if output is not None and output.suffix != ".mcap":
        raise UsageError(f"'{output}' is not called .mcap", where="--output", todo=f"Write -o {output.stem}.mcap")
    if recover:
        return _recover(recover, output, json)
    description = load_named(hand, model, namespace).description
    address = choose_endpoint(endpoint)
    if keep:
        return _keep(description, address, json)
    path = output or Path(f"{description.namespace.replace('/', '-')}-{datetime.now(UTC):%Y%m%dT%H%M%SZ}.mcap")
    done, size = _record(description, address, path, seconds)
    if json != "-":
        _show(path, done, size)
    emit_json(json, _result(path, done, size))
    return 0


def _record(description: HandDescription, address: str, path: Path, seconds: float | None) -> tuple[Recorded, int]:
    """What was recorded, and the size of the file in bytes. Raises NoAnswer when nothing was; then there is no file."""
    from bridges.zenoh.connection import Connection
    from bridges.zenoh.listening import listening
    from twin_daemon.recordings.mcap_file import refuse_existing
    from twin_daemon.services.recorder import Recorder
    from twin_daemon.services.stop import on_termination

    refuse_existing(path)
    end_s = float("inf") if seconds is None else time.monotonic() + seconds
    with ExitStack() as stack:
        stop = stack.enter_context(on_termination())
        connection = stack.enter_context(Connection(address))
        console = progress_console()
        line = stack.enter_context(console.status(f"waiting for {address}")) if console.is_terminal else None
        while connection.session is None and not _over(stop, end_s):
            connection.wait(min(0.1, max(end_s - time.monotonic(), 0.0)))
        if connection.session is None:
            raise NoAnswer(f"nothing listens at {address}", todo="Start the daemon with 'twin run'. Nothing is written")
        with Recorder(listening(connection.session), description, path) as recorder:
            begin_s = time.monotonic()
            while not _over(stop, end_s):
                recorder.work(min(_TURN_S, max(end_s - time.monotonic(), 0.0)), stop)
                if line is not None:
                    line.update(_line(recorder.done, time.monotonic() - begin_s))
    done = recorder.done
    if not done.messages.total():
        refused = f", but {done.refused.total()} messages that cannot be read" if done.refused else ""
        raise NoAnswer(
            f"nothing arrived at {description.key('joint_states')}{refused}",
            todo="Is the hand running? Same --hand, --namespace and --endpoint? Nothing is written",
        )
    return done, recorder.bytes


def _over(stop: Stoppable, end_s: float) -> bool:
    return stop.is_set() or time.monotonic() >= end_s


def _recover(part: Path, output: Path | None, json: str | None) -> int:
    from twin_daemon.recordings.mcap_file import PART
    from twin_daemon.recordings.recover import recover

    target = output or part.with_name(part.name.removesuffix(PART).removesuffix(".mcap") + "-recovered.mcap")
    messages = recover(part, target)
    people(json).print(
        plain_text(f"{messages} messages of {part} are now in {target}; the .part can be removed"), soft_wrap=True
    )
    emit_json(json, {"path": str(target), "messages": messages})
    return 0


def _keep(description: HandDescription, address: str, json: str | None) -> int:
    from bridges.zenoh.client import ask_once

    answer = ask_once(address, description.key("keep"), _KEEP_TIMEOUT_S)
    emit_json(json, answer)
    if not answer["kept"]:
        if not answer["messages"]:
            raise NoAnswer(f"nothing was kept: {answer['why']}")
        raise BadInput(f"nothing was kept: {answer['why']}", where=address)
    if json != "-":
        people().print(plain_text(answer["path"]), soft_wrap=True)
        limit = " (as much as keep_mib allows)" if answer["limited_by"] == "keep_mib" else ""
        progress_console().print(
            f"{answer['messages']} messages of {answer['seconds']:.0f} s{limit}, {answer['bytes'] / 2**20:.1f} MiB"
        )
    return 0


def _line(done: Recorded, passed_s: float) -> str:
    counts = ", ".join(f"{topic} {count}" for topic, count in done.messages.items())
    return f"{passed_s:.0f} s: {counts}, refused {done.refused.total()}, dropped {done.dropped}"


def _show(path: Path, done: Recorded, size: int) -> None:
    from rich.table import Table

    table = Table(title=plain_text(path.name))
    table.add_column("topic")
    for column in ("messages", "per second", "refused"):
        table.add_column(column, justify="right")
    for topic, count in done.messages.items():
        rate = done.rate_hz(topic)
        table.add_row(topic, str(count), "-" if rate is None else f"{rate:.1f}", str(done.refused[topic]))
    console = people()
    console.print(table)
    console.print(
        plain_text(f"{done.duration_s:.1f} s, {size / 2**20:.1f} MiB, {done.dropped} dropped: {path}"), soft_wrap=True
    )


def _result(path: Path, done: Recorded, size: int) -> dict[str, Any]:
    return {
        "path": str(path),
        "bytes": size,
        "duration_s": done.duration_s,
        "messages": done.messages.total(),
        "topics": {
            topic: {"messages": count, "rate_hz": done.rate_hz(topic), "refused": done.refused[topic]}
            for topic, count in done.messages.items()
        },
        "refused": done.refused.total(),
        "dropped": done.dropped,
    }
