"""Where and with what a number was measured."""

from __future__ import annotations

import contextlib
import os
import platform
import subprocess
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import twin_daemon

_ROOT = Path(__file__).resolve().parents[1]
_PACKAGES = ("mujoco", "numpy", "scipy", "scikit-optimize", "cma", "eclipse-zenoh", "distributed")


def machine() -> str:
    """The processor, how many of its cores this process may use, and how busy they are."""
    name = platform.machine()
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        name = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), name)
    return f"{name}, {len(os.sched_getaffinity(0))} cores, load {os.getloadavg()[0]:.1f} at the start"


def versions() -> dict[str, str]:
    """Versions by package; what is not installed is left out."""
    found = {"Python": platform.python_version(), "twin_daemon": twin_daemon.__version__}
    for package in _PACKAGES:
        with contextlib.suppress(PackageNotFoundError):
            found[package] = version(package)
    return found


def provenance(command: str) -> dict[str, Any]:
    """What stands beside every number: the command, the machine, the versions, the commit and the date."""
    return {
        "command": command,
        "machine": machine(),
        "versions": versions(),
        "commit": commit(),
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    }


def in_words(about: Mapping[str, Any]) -> str:
    """The same on one line, for a page; with the time that it took where that is known."""
    versions = ", ".join(f"{name} {number}" for name, number in about["versions"].items())
    took = f", {about['wall_s']:.0f} s" if "wall_s" in about else ""
    commit = about["commit"] or "unknown"
    return f"`{about['command']}`{took}; {about['date']}, commit {commit}; {about['machine']}; {versions}."


def commit() -> str | None:
    """The commit that was measured, with a + where files differ from it; None outside of a repository."""
    with contextlib.suppress(OSError, subprocess.CalledProcessError):
        short = _git("rev-parse", "--short", "HEAD")
        return short + ("+" if _git("status", "--porcelain", "--", "twin_daemon", "bridges", "bench") else "")
    return None


def _git(*arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=_ROOT, capture_output=True, text=True, check=True)
    return done.stdout.strip()
