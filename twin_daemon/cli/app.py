"""`twin`: finds the command, runs it, and turns whatever happens into an exit code and at most one line."""

from __future__ import annotations

import importlib
import os
from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup

import twin_daemon
from twin_daemon.cli.command import single
from twin_daemon.cli.failures import guarded
from twin_daemon.errors import nearest
from twin_daemon.privileges import work_as_owner
from twin_daemon.resources import state_dir


class Entry(NamedTuple):
    """Where a command is, and what `twin --help` says of it without loading it."""

    module: str  # under twin_daemon.cli; has `app` (a Group) or `command` (a function)
    help: str
    panel: str = "Commands"


OFFLINE, LIVE, STATE = "With recordings", "Live", "Versions and setup"

# One line a command, in the order of the help.
COMMANDS: dict[str, Entry] = {
    "demo": Entry("demo", "The whole story without a hand: follow, learn, watch the error fall.", LIVE),
    "run": Entry("run", "The daemon: follow the hand, predict it, measure the error, answer questions.", LIVE),
    "gate": Entry("gate", "The gate alone, the only way to the hand; 'twin run' starts it by itself.", LIVE),
    "hand": Entry("hand", "A simulated hand in place of the real one, with wear and hidden effects.", LIVE),
    "play": Entry("play", "Recordings as if they were the hand.", LIVE),
    "record": Entry("record", "What hand and twin say, as an MCAP file; --keep saves the daemon's last minutes.", LIVE),
    "bridge": Entry("bridge", "Join a ROS 2 system and the twin.", LIVE),
    "command": Entry("hand_commands", "Commands to the real hand, through a gate: arm, move, trajectory, stop.", LIVE),
    "consent": Entry("consent", "Whether the twin may move the hand by itself: given, shown, withdrawn.", STATE),
    "workbench": Entry("workbench", "A page in the browser: live, compare, diagnose, add, history.", LIVE),
    "audit": Entry("audit", "The audit log: who asked for what, and whether the log is intact.", STATE),
    "fleet": Entry("fleet", "The hands of one network, and how each is.", LIVE),
    "query": Entry("query", "Ask the daemon: state, residual, version, health, drift, events, model.", LIVE),
    "compare": Entry("compare", "The model against measurements, joint by joint.", OFFLINE),
    "check": Entry("check", "What the data can and cannot tell, before a fit.", OFFLINE),
    "calibrate": Entry("calibrate", "Fit parameters to recordings and store the result as a version.", OFFLINE),
    "recalibrate": Entry(
        "recalibrate", "Follow the wear: refit the version in use, and decide if it is better.", OFFLINE
    ),
    "diagnose": Entry("diagnose", "Which physical effect the twin lacks, with evidence.", OFFLINE),
    "propose": Entry("propose", "The law that is missing where no effect of the library fits.", OFFLINE),
    "add": Entry("add", "Put an effect into the twin, fitted where there are recordings.", OFFLINE),
    "remove": Entry("remove", "Take an effect out of the twin again.", OFFLINE),
    "ladder": Entry("ladder", "Diagnose, add, refit, again: watch the error fall.", OFFLINE),
    "report": Entry("report", "One page with the comparison, the diagnosis, the ladder and the parameters.", OFFLINE),
    "effects": Entry("effects", "The library of physical effects; KEY explains one.", OFFLINE),
    "doctor": Entry("doctor", "What is missing on this machine.", STATE),
    "security": Entry("security", "Who may join the hand's network: identities and their certificates.", STATE),
    "service": Entry("service", "The twin as a service of systemd: install, status, logs, uninstall.", STATE),
    "config": Entry("config", "The daemon's configuration: checked, shown with where each value came from.", STATE),
    "versions": Entry("versions", "What was learned: list, promote, roll back, history, verify, back up.", STATE),
}


_AS_ROOT = ("service",)
"""Commands that change the system. All others of root's work as whoever owns the state folder."""


class LazyGroup(TyperGroup):
    """A group that knows its commands by name and imports one only when it is called."""

    def list_commands(self, ctx: Any) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        entry = COMMANDS.get(cmd_name)
        if entry is None:
            return None
        return TyperCommand(name=cmd_name, help=entry.help, short_help=entry.help, rich_help_panel=entry.panel)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        name = args[0]
        if name not in COMMANDS:
            if name.startswith("-"):
                return super().resolve_command(ctx, args)
            ctx.fail(f"There is no command '{name}'. {nearest(name, COMMANDS)}.".replace("?.", "?"))
        if name not in _AS_ROOT:
            work_as_owner(state_dir())
        return name, load(name), args[1:]


def load(name: str) -> Any:
    """Import the module of a command and build the command."""
    module = importlib.import_module(f"twin_daemon.cli.{COMMANDS[name].module}")
    built = typer.main.get_command(module.app) if hasattr(module, "app") else single(name, module.command)
    built.name = name
    return built


_app = typer.Typer(cls=LazyGroup, add_completion=True, pretty_exceptions_enable=False)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"twin {twin_daemon.__version__}")
        raise typer.Exit


@_app.callback(epilog="Every command has --help. Results go to --json PATH as well ('-' is standard output).")
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and end.")
    ] = False,
) -> None:
    """A live digital twin of a robot hand that measures its own error, names what it does not model, and grows."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code (see `failures`)."""
    os.environ.setdefault("MUJOCO_GL", "disable")  # nothing is rendered, and loading OpenGL takes time
    return guarded(typer.main.get_command(_app), argv)
