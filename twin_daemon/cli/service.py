"""`twin service`: the twin as a service of systemd."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from twin_daemon.cli import units
from twin_daemon.cli.command import Group
from twin_daemon.cli.console import emit_json, people, plain_text
from twin_daemon.cli.options import Json
from twin_daemon.cli.units import FOLDER
from twin_daemon.errors import BadInput, NoAnswer
from twin_daemon.privileges import read_regular

app = Group("The twin as a service of systemd: installed, looked at, removed. Its state always stays.")

Root = Annotated[
    Path, typer.Option("--root", metavar="DIR", help="Install into this tree of a system that does not run.")
]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Say what would be done, and do nothing.")]
Yes = Annotated[bool, typer.Option("--yes", "-y", help="Do not ask. Without a terminal nothing is asked anyway.")]
_RUNNING = Path("/run/systemd/system")


@dataclass(frozen=True)
class Step:
    """One thing that is done, in words and as a call."""

    words: str
    do: Callable[[], object]


@app.command("install")
def install(
    root: Root = Path("/"),
    executable: Annotated[
        Path | None, typer.Option("--executable", metavar="PATH", help="The 'twin' to run; default: this one.")
    ] = None,
    start: Annotated[bool, typer.Option("--start/--no-start", help="Start it at once.")] = True,
    dry_run: DryRun = False,
    yes: Yes = False,
    json: Json = None,
) -> None:
    """Install the units for this installation and start them. Repeated after an upgrade it brings them up to date."""
    root = root.resolve()
    program = executable or _this_program()
    if _live(root):
        units.require_readable(program, program.resolve(), *([] if executable else [Path(sys.base_prefix).resolve()]))
    files = units.planned(program)
    enabled, left_out = _wanted()
    steps = [
        Step(
            f"leave {root / file.place} as it is"
            if file.personal and (root / file.place).exists()
            else f"write {root / file.place}",
            lambda: None,
        )
        for file in files
    ]
    steps.append(Step(f"record that in {root / units.RECEIPT}", lambda: units.write(root, files)))
    steps.append(Step(f"make sure that there are keys in {root / units.KEYS}", lambda: _ensure_keys(root)))
    where = [] if _live(root) else [f"--root={root}"]
    steps.append(_call("systemd-sysusers", *where, "twin-daemon.sysusers.conf"))
    steps.append(Step(f"give each unit a key of its own in {root / units.CONFIG / FOLDER}", lambda: _give_keys(root)))
    if _live(root):
        steps.append(_call("systemctl", "daemon-reload"))
    steps.append(_call("systemctl", *where, "enable", *enabled))
    if _live(root) and start:
        steps.append(_call("systemctl", "restart", units.TARGET, *(name for name in enabled if name != units.TARGET)))
    _perform(steps, root, dry_run, yes, json, notes=left_out)


@app.command("uninstall")
def uninstall(root: Root = Path("/"), dry_run: DryRun = False, yes: Yes = False, json: Json = None) -> None:
    """Stop and remove everything that install wrote. Versions, recordings, keys and the user 'twin' stay."""
    root = root.resolve()
    if not units.receipt(root):
        raise BadInput("nothing is installed here", where=root / units.RECEIPT, todo="'twin service install' does it")
    where = [] if _live(root) else [f"--root={root}"]
    now = ["--now"] if _live(root) else []
    steps = [
        _call("systemctl", *where, "disable", *now, *units.UNITS),
        Step(f"take back the units' keys in {root / units.CONFIG / FOLDER}", lambda: _take_keys(root)),
        *(Step(f"remove {root / place}", lambda: None) for place in units.receipt(root)),
        Step(f"remove {root / units.RECEIPT}", lambda: _remove(root, json)),
    ]
    if _live(root):
        steps.append(_call("systemctl", "daemon-reload"))
    stay = [path for path in (root / units.KEYS, root / units.STATE) if path.exists()]
    notes = [f"{path} stays" for path in stay]
    _perform(steps, root, dry_run, yes, json, notes=[*notes, "the user 'twin' stays: what it owns has to be its own"])


@app.command("status")
def status(json: Json = None) -> None:
    """Whether the units run, since when and how often they were restarted. Exit code 5 if the daemon does not."""
    from twin_daemon.tables import slim_table

    _require_systemd("systemctl")
    wanted = ("LoadState", "ActiveState", "SubState", "UnitFileState", "MainPID", "NRestarts", "ActiveEnterTimestamp")
    found: dict[str, dict[str, str]] = {}
    for name in units.UNITS:
        text = _run("systemctl", "show", name, f"--property={','.join(wanted)}")
        found[name] = dict(line.split("=", 1) for line in text.splitlines() if "=" in line)
    table = slim_table("service", ("unit", "state", "at boot", "restarts", "since"), words=("since",))
    for name, one in found.items():
        state = one["ActiveState"] if one.get("LoadState") == "loaded" else "not installed"
        cells = (state, one.get("UnitFileState") or "-", one.get("NRestarts", "-"), one.get("ActiveEnterTimestamp", ""))
        table.add_row(name, *map(plain_text, cells))
    people(json).print(table)
    runs = found[units.DAEMON].get("ActiveState") == "active"
    emit_json(json, {"runs": runs, "units": found})
    if not runs:
        raise NoAnswer(
            f"{units.DAEMON} does not run", todo="'twin service logs' says why, 'twin service install' starts"
        )


@app.command("logs")
def logs(
    lines: Annotated[int, typer.Option("--lines", "-n", metavar="N", min=1, help="How many of the last.")] = 100,
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Keep showing new lines.")] = False,
) -> int:
    """What the units said last, from the journal."""
    _require_systemd("journalctl")
    chosen = [f"--unit={name}" for name in units.UNITS]
    more = ["--follow"] if follow else []
    return subprocess.run(["journalctl", "--no-pager", f"--lines={lines}", *more, *chosen]).returncode


def _wanted() -> tuple[list[str], list[str]]:
    """The units that are started with the machine, and why others are not."""
    enabled, left_out = [units.GATE, units.DAEMON], []
    if importlib.util.find_spec("rclpy") is not None:
        enabled.append(units.BRIDGE)
    else:
        left_out.append(f"{units.BRIDGE} is not started: this Python has no ROS 2 (systemd/README.md)")
    return [*enabled, units.WORKBENCH, units.TARGET], left_out


def _this_program() -> Path:
    """The `twin` beside the Python that runs this; a link stays what it is, so that a new Python may take its place."""
    beside = Path(sys.executable).with_name("twin")
    found = beside if beside.is_file() else shutil.which("twin")
    if not found:
        raise BadInput("the 'twin' of this installation was not found", where=beside, todo="Name it with --executable")
    return Path(found).absolute()


def _perform(steps: list[Step], root: Path, dry_run: bool, yes: bool, json: str | None, notes: list[str]) -> None:
    console = people(json)
    for step in steps:
        console.print(plain_text(f"{'would ' if dry_run else 'will '}{step.words}"), soft_wrap=True)
    for note in notes:
        console.print(plain_text(note), soft_wrap=True)
    if not dry_run:
        _require_rights(root)
        if sys.stdin.isatty() and not yes:
            typer.confirm("Go on?", abort=True, err=True)
        for step in steps:
            step.do()
        console.print("done")
    said = [step.words for step in steps]
    emit_json(json, {"done": not dry_run, "root": str(root), "steps": said, "notes": notes})


def _remove(root: Path, json: str | None) -> None:
    for path in units.remove(root):
        people(json).print(plain_text(f"{path} was edited by hand and stays"), soft_wrap=True)


def _ensure_keys(root: Path) -> None:
    """Identities of their own, or those that a daemon of before has in its state folder."""
    from twin_daemon.cli.unit_identities import with_unit_identities
    from twin_daemon.files import write_atomically
    from twin_daemon.security.identity import ensure_keyring

    path, state = root / units.KEYS, root / units.STATE
    if not path.exists() and state.is_dir():
        owner = state.stat()  # whoever owns that folder may put a link into it
        before = read_regular(state / "keys.json", (owner.st_uid,))
        if before is not None:
            write_atomically(path, before, mode=0o600)
    with_unit_identities(ensure_keyring(path)).save(path)


def _give_keys(root: Path) -> None:
    """What the units but the daemon need of the keys, and of the certificates of before."""
    from twin_daemon.cli.unit_identities import certificates, hand_out
    from twin_daemon.security.identity import load_keyring

    keys = root / units.KEYS
    certified = certificates(root / units.STATE / "security")
    hand_out(keys, load_keyring(keys), root / "etc/passwd", certified)


def _take_keys(root: Path) -> None:
    from twin_daemon.cli.unit_identities import take_back

    take_back(root / units.KEYS)


def _call(name: str, *arguments: str) -> Step:
    return Step(f"run {name} {' '.join(arguments)}", lambda: _run(name, *arguments))


def _run(name: str, *arguments: str) -> str:
    if shutil.which(name) is None:
        raise BadInput(f"there is no {name} on this machine", todo=f"Run it in that system: {' '.join(arguments)}")
    done = subprocess.run([name, *arguments], capture_output=True, text=True)
    if done.returncode != 0:
        said = " ".join(done.stderr.split()) or f"exit code {done.returncode}"
        raise BadInput(f"'{name} {' '.join(arguments)}' failed: {said}", todo="Mend that and repeat this command")
    return done.stdout


def _live(root: Path) -> bool:
    """Whether it is the system that runs here, under systemd."""
    return root == Path("/") and _RUNNING.is_dir()


def _require_rights(root: Path) -> None:
    if not root.is_dir():
        raise BadInput("there is no such folder", where=root, todo="Give --root the folder of a system")
    folder = next(one for one in (root / "etc", root) if one.is_dir())
    if not os.access(folder, os.W_OK):
        raise BadInput(
            "only root may do this",
            where=folder,
            todo=f"sudo {_this_program()} service ...; for yourself alone 'twin run' needs no service",
        )


def _require_systemd(tool: str) -> None:
    if not _RUNNING.is_dir() or shutil.which(tool) is None:
        raise NoAnswer("systemd does not run on this machine", todo="Start the daemon with 'twin run'")
