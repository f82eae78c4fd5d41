"""`twin demo`: the whole story without a hand, in about a minute and a half."""

from __future__ import annotations

import json as json_module
import shutil
import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin_daemon.cli.children import Children, free_port
from twin_daemon.cli.console import counted, emit_json, people, plain_text
from twin_daemon.cli.options import Json, Seed

if TYPE_CHECKING:
    from collections.abc import Callable

    import zenoh
    from rich.console import Console
    from rich.table import Table

    from twin_daemon.hand import Hand

_WORN = ("coulomb_friction:rh_FFJ3", "viscous_friction:rh_FFJ0")
_SPREAD = "0.3"
_LEARN, _JUDGE = "rich_finger", "index_closing"  # one finger: calibrated within seconds on two cores
_JUDGE_S = 9.0
_LONGEST_S = "400"  # the children end by themselves even if this process is killed
_SHOWN = 8


def command(
    record_seconds: Annotated[
        float, typer.Option("--record-seconds", metavar="S", min=6.0, max=120.0, help="Length of the recording.")
    ] = 15.0,
    budget: Annotated[int, typer.Option("--budget", metavar="N", min=20, help="Simulations of the calibration.")] = 400,
    seed: Seed = 7,
    json: Json = None,
) -> int:
    """The whole story without hardware: a worn, simulated hand, its twin, a recording, a calibration, less error."""
    from bridges.zenoh.session import open_client
    from twin_daemon.errors import NoAnswer
    from twin_daemon.hand import load_hand
    from twin_daemon.resources import state_dir

    begun_s = time.monotonic()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends like Ctrl-C: the children are ended first
    console = people(json)
    folder = state_dir() / "demo"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with Children(folder, {"TWIN_ENDPOINT": endpoint, "TWIN_STATE_DIR": str(folder)}) as children:
        console.print("[bold]1. A worn hand, and its twin beside it[/bold]")
        console.print(
            f"   The hand differs from the model by up to {float(_SPREAD):.0%} and hides {' and '.join(_WORN)}."
        )
        children.start("run", "run", "--seconds", _LONGEST_S)
        _start_hand(children, _LEARN, seed)
        session = open_client(endpoint, 20.0)
        if session is None:
            children.check()
            raise NoAnswer("the daemon of the demo did not start", todo=f"See {folder}")
        with session:
            result = _story(console, session, children, load_hand(), folder, record_seconds, budget, seed)
    result["seconds"] = round(time.monotonic() - begun_s, 1)
    _next(console, folder, result)
    emit_json(json, result)
    return 0


def _story(
    console: Console,
    session: zenoh.Session,
    children: Children,
    hand: Hand,
    folder: Path,
    seconds: float,
    budget: int,
    seed: int,
) -> dict[str, Any]:
    """What happens while both processes run. Returns what was measured."""
    train, holdout = folder / "learn.mcap", folder / "validation.mcap"
    console.print(f"[bold]2. Recording '{_LEARN}' for {seconds:.0f} s, measured against predicted, live[/bold]")
    _record(console, session, children, hand, train, seconds)
    console.print(f"[bold]3. Another motion, '{_JUDGE}', as validation data: no fit ever sees it[/bold]")
    children.end("hand")
    _until(session, hand, children, lambda state: state["stale"])
    _start_hand(children, _JUDGE, seed)
    _record(console, session, children, hand, holdout, min(seconds, _JUDGE_S))
    before = _live_error(session, hand, children)
    console.print("[bold]4. Calibrating: twin calibrate --search least-squares --space physical[/bold]")
    console.print("   takes about 20 s, while the twin goes on")
    report = folder / "calibrate.json"
    children.run(
        "calibrate", "calibrate", "--recording", str(train), "--holdout", str(holdout),
        "--search", "least-squares", "--space", "physical", "--budget", str(budget), "--json", str(report),
    )  # fmt: skip
    found = json_module.loads(report.read_text(encoding="utf-8"))
    console.print(
        f"   {found['evaluations']} simulations in {found['wall_s']:.0f} s, stored as {found['version'][:12]}"
    )
    console.print("[bold]5. Promoting it: the running twin takes it over[/bold]")
    children.run("promote", "versions", "promote", found["version"])
    _until(session, hand, children, lambda state: state["version"] == found["version"])
    _record(console, session, children, hand, None, min(seconds, _JUDGE_S))
    after = _live_error(session, hand, children)
    _compare(console, found, before, after)
    errors = {key: found[key] for key in ("before", "after", "holdout_before", "holdout_after")}
    return errors | {"live_before_mse_rad2": before, "live_after_mse_rad2": after, "version": found["version"]}


def _start_hand(children: Children, motion: str, seed: int) -> None:
    worn = [part for effect in _WORN for part in ("--hidden", effect)]
    children.start(
        "hand", "hand", "--trajectory", motion, "--seed", str(seed), "--spread", _SPREAD, *worn, "--seconds", _LONGEST_S
    )  # fmt: skip


def _record(
    console: Console,
    session: zenoh.Session,
    children: Children,
    hand: Hand,
    path: Path | None,
    seconds: float,
) -> None:
    """Shows the live state for some seconds, and writes it down where a path is given."""
    from contextlib import ExitStack

    from rich.live import Live

    from bridges.zenoh.client import ask
    from bridges.zenoh.listening import listening
    from twin_daemon.services.recorder import Recorder

    key = hand.description.key("state")
    _until(session, hand, children, _moves)
    with ExitStack() as stack:
        recorder = (
            stack.enter_context(Recorder(listening(session), hand.description, path)) if path is not None else None
        )
        live = stack.enter_context(Live(console=console, transient=True)) if console.is_terminal else None
        end_s, next_line_s = time.monotonic() + seconds, 0.0
        while (left_s := end_s - time.monotonic()) > 0:
            pause_s = min(0.25, left_s)
            recorder.work(pause_s) if recorder is not None else time.sleep(pause_s)
            children.check()
            state = ask(session, key)
            if live is not None:
                live.update(_table(state, left_s))
            elif time.monotonic() >= next_line_s:
                next_line_s = time.monotonic() + 3.0
                console.print("   " + _line(state), soft_wrap=True)
    if recorder is not None and path is not None:
        done = recorder.done
        console.print(f"   wrote {done.joint_states} joint states and {done.joint_commands} commands to {path.name}")


def _moves(state: dict[str, Any]) -> bool:
    """Whether the twin follows commands and all joints are fresh."""
    return state["status"] == "following" and state["fresh_joints"] == len(state["joints"])


def _until(session: zenoh.Session, hand: Hand, children: Children, reached: Callable[[dict[str, Any]], bool]) -> None:
    """Waits for a state of the live twin."""
    from bridges.zenoh.client import ask
    from twin_daemon.errors import NoAnswer

    deadline_s = time.monotonic() + 20.0
    while time.monotonic() < deadline_s:
        if reached(ask(session, hand.description.key("state"), 10.0)):
            return
        children.check()
        time.sleep(0.1)
    raise NoAnswer("the processes of the demo did not get going")


def _live_error(session: zenoh.Session, hand: Hand, children: Children) -> float | None:
    """Mean squared error of the live prediction over the last seconds, over the joints that move."""
    from bridges.zenoh.client import ask

    children.check()
    return ask(session, hand.description.key("residual"))["mse_rad2"]


# -- what people see ---------------------------------------------------------------------------------------


def _worst(state: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    known = [(name, joint) for name, joint in state["joints"].items() if joint["residual_rad"] is not None]
    return sorted(known, key=lambda item: -abs(item[1]["residual_rad"]))[:_SHOWN]


def _table(state: dict[str, Any], left_s: float) -> Table:
    from rich.table import Table

    table = Table(title=f"{counted(state['fresh_joints'], 'joint')} fresh, {left_s:.0f} s left, largest residuals now")
    table.add_column("joint")
    for column in ("measured rad", "predicted rad", "residual mrad"):
        table.add_column(column, justify="right")
    for name, joint in _worst(state):
        table.add_row(
            plain_text(name),
            f"{joint['measured_rad']:.3f}",
            f"{joint['predicted_rad']:.3f}",
            f"{1e3 * joint['residual_rad']:+.1f}",
        )
    return table


def _line(state: dict[str, Any]) -> str:
    worst = [f"{name} {1e3 * joint['residual_rad']:+.0f} mrad" for name, joint in _worst(state)[:3]]
    return f"{counted(state['fresh_joints'], 'joint')} fresh; largest residuals: {', '.join(worst) or 'none yet'}"


def _compare(console: Console, found: dict[str, Any], live_before: float | None, live_after: float | None) -> None:
    from rich.table import Table

    table = Table(title="Mean squared error, rad²")
    for column in ("", "before", "after", "less"):
        table.add_column(column, justify="right" if column else "left")
    rows = (
        ("fitted motion", found["before"]["mse_rad2"], found["after"]["mse_rad2"]),
        ("validation data", found["holdout_before"]["mse_rad2"], found["holdout_after"]["mse_rad2"]),
        ("live, all joints", live_before, live_after),
    )
    for label, before, after in rows:
        if before is None or after is None:
            table.add_row(label, "-", "-", "-")
        else:
            table.add_row(label, f"{before:.3g}", f"{after:.3g}", f"{1 - after / before:.0%}" if before else "-")
    console.print(table)


def _next(console: Console, folder: Path, result: dict[str, Any]) -> None:
    recording = folder / "validation.mcap"
    console.print(f"[bold]Done in {result['seconds']:.0f} s.[/bold] All processes have ended. Try next:")
    for line in (
        f"export TWIN_STATE_DIR={folder}",
        "twin versions list",
        f"twin compare --recording {recording}",
        "twin hand --hidden backlash:rh_FFJ3 &  twin run &  twin query state",
    ):
        console.print(f"   {line}", markup=False, soft_wrap=True)
