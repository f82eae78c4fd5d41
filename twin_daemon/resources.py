"""Where the models, trajectories, state and command of this installation are."""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path

import platformdirs

_PACKAGE = Path(__file__).resolve().parent

SWITCH_S = 1e-4
"""A thread that works in Python keeps the others waiting for so long; a sample is not to notice."""


def _data_dir(name: str) -> Path:
    """The folder `name` beside the package in a checkout, or the copy that a wheel carries inside it."""
    inside = _PACKAGE / "_data" / name
    return inside if inside.is_dir() else _PACKAGE.parent / name


def twin_command(*arguments: str) -> list[str]:
    """The command that runs `twin ARGUMENTS` with this interpreter, whatever is on the PATH."""
    return [sys.executable, "-c", "import sys; from twin_daemon.cli.app import main; sys.exit(main())", *arguments]


def models_dir() -> Path:
    """Folder of hand descriptions, one folder a hand."""
    return _data_dir("models")


def trajectories_dir() -> Path:
    """Folder of the trajectories that come with this package."""
    return _data_dir("trajectories")


def systemd_dir() -> Path:
    """Folder of the units, and of the configuration that comes with them."""
    return _data_dir("systemd")


def state_dir() -> Path:
    """Folder of versions, recordings and the audit log; created by whoever writes first.

    TWIN_STATE_DIR wins; under systemd STATE_DIRECTORY is set (several are separated by colons: the first is ours).
    """
    chosen = os.environ.get("TWIN_STATE_DIR") or os.environ.get("STATE_DIRECTORY", "").split(":")[0]
    return Path(chosen).expanduser() if chosen else platformdirs.user_state_path("twin_daemon")


def own_state_dir() -> Path:
    """What a service keeps for itself alone, where systemd gave it a folder; else the state folder."""
    given = os.environ.get("STATE_DIRECTORY", "").split(":")[0]
    return Path(given) if given else state_dir()


def step_back(pid: int, nice: int) -> None:
    """Lets a process give way: in the processor's time, and as the first one to go where memory ends."""
    with contextlib.suppress(OSError):  # it has ended already
        os.setpriority(os.PRIO_PROCESS, pid, nice)
        Path(f"/proc/{pid}/oom_score_adj").write_text("1000")
