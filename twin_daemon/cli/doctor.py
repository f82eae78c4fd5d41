"""`twin doctor`: what this machine has, and what is missing."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import platform
import shutil
import socket
import sys
import time
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from importlib import metadata
from pathlib import Path
from typing import Literal

from twin_daemon.cli.console import counted, emit_json, people, plain_text
from twin_daemon.cli.options import Endpoint, Json

Level = Literal["ok", "note", "problem"]
_PACKAGES = ("twin_daemon", "mujoco", "eclipse-zenoh", "rosbags", "numpy", "scipy", "scikit-optimize", "pydantic")
_ROS = ("rclpy", "sensor_msgs", "trajectory_msgs", "std_msgs")
_FREE_BYTES = 500 * 2**20
_YEAR_OF_RELEASE = 2025
_SOON = timedelta(days=30)
_TIMEX_BYTES, _TIME_ERROR = 256, 5  # adjtimex(2): more than its struct takes; what it answers for a clock on its own


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at. A `note` limits what can be done, a `problem` stops the work."""

    what: str
    level: Level
    found: str
    todo: str = ""


def command(endpoint: Endpoint = None, json: Json = None) -> int:
    """What is there and what is missing on this machine. Exit code 1 when there is a problem."""
    from rich.table import Table

    from bridges.zenoh.session import choose_endpoint

    findings = [
        _python(),
        *_packages(),
        _hand(),
        _ros(),
        _port(choose_endpoint(endpoint)),
        *_state(),
        *_certificates(),
        _clock(),
        _cores(),
    ]
    table = Table(title="twin doctor")
    for column in ("what", "", "found", "what to do"):
        table.add_column(column, overflow="fold")
    colour = {"ok": "green", "note": "yellow", "problem": "red"}
    for finding in findings:
        mark = f"[{colour[finding.level]}]{finding.level}[/]"
        table.add_row(finding.what, mark, plain_text(finding.found), plain_text(finding.todo))
    people(json).print(table)
    healthy = all(finding.level != "problem" for finding in findings)
    emit_json(json, {"healthy": healthy, "findings": [asdict(finding) for finding in findings]})
    return 0 if healthy else 1


def _python() -> Finding:
    fits = sys.version_info >= (3, 11)
    todo = "" if fits else "Install Python 3.11 or newer"
    return Finding("python", "ok" if fits else "problem", f"{platform.python_version()} ({platform.machine()})", todo)


def _packages() -> list[Finding]:
    found = []
    for name in _PACKAGES:
        try:
            found.append(Finding(name, "ok", metadata.version(name)))
        except metadata.PackageNotFoundError:
            found.append(Finding(name, "problem", "missing", "Run 'make setup', or install the wheel again"))
    return found


def _hand() -> Finding:
    from twin_daemon.errors import TwinError
    from twin_daemon.hand import load_hand

    try:
        hand = load_hand()
    except TwinError as error:
        return Finding("hand", "problem", error.line(), "Install the package again")
    return Finding(
        "hand", "ok", f"{hand.name}, {counted(len(hand.joints), 'joint')}, {counted(len(hand.commands), 'command')}"
    )


def _ros() -> Finding:
    missing = [name for name in _ROS if importlib.util.find_spec(name) is None]
    if not missing:
        return Finding("ROS 2", "ok", os.environ.get("ROS_DISTRO", "its Python packages are there"))
    todo = "Only for 'twin bridge ros2': run 'make setup-ros', or see docs/install.md for your own"
    return Finding("ROS 2", "note", f"not there ({', '.join(missing)})", todo)


def _port(endpoint: str) -> Finding:
    """Whether the daemon could listen where it would by default."""
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.rpartition(":")
    if protocol not in ("tcp", "tls") or not port.isdigit():
        return Finding("endpoint", "note", f"{endpoint}: not looked at, only tcp and tls are")
    try:
        with socket.create_connection((host, int(port)), timeout=0.5):
            return Finding("endpoint", "ok", f"{endpoint}: somebody listens there, a twin or a router")
    except OSError:
        pass
    try:
        with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host.strip("[]"), int(port)))
    except OSError as error:
        todo = "Choose another with --endpoint or TWIN_ENDPOINT"
        return Finding("endpoint", "problem", f"{endpoint}: {error.strerror or error}", todo)
    return Finding("endpoint", "ok", f"{endpoint}: free")


def _state() -> list[Finding]:
    """The state folder, or the nearest parent that is there, without leaving anything in it."""
    from twin_daemon.resources import state_dir

    folder = state_dir().absolute()
    existing = next((one for one in (folder, *folder.parents) if one.exists()), Path("/"))
    writable = existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)
    todo = "" if writable else "Give it to this user, or set TWIN_STATE_DIR"
    free = shutil.disk_usage(existing).free
    return [
        Finding("state folder", "ok" if writable else "problem", str(folder), todo),
        Finding(
            "disk",
            "ok" if free > _FREE_BYTES else "note",
            f"{free / 2**30:.1f} GiB free",
            "" if free > _FREE_BYTES else "Recordings and versions need room",
        ),
    ]


def _certificates() -> list[Finding]:
    """Those of `twin security`, where there are any: whether one ends soon."""
    from twin_daemon.security.certificate_authority import certificate_of
    from twin_daemon.security.tls import CERTIFICATE, security_dir

    found = {folder.parent.name: certificate_of(folder.parent) for folder in security_dir().glob(f"*/{CERTIFICATE}")}
    ends = {name: one.not_valid_after_utc for name, one in found.items() if one is not None}
    if not ends:
        return []
    first = min(ends, key=lambda name: ends[name])
    left = ends[first] - datetime.now(UTC)
    text = f"{len(ends)}; the first that ends is that of {first}, {ends[first]:%Y-%m-%d}"
    if left > _SOON:
        return [Finding("certificates", "ok", text)]
    level: Level = "note" if left > timedelta(0) else "problem"
    return [
        Finding("certificates", level, text, "Run 'twin security init', copy the folders again, restart the daemon")
    ]


def _clock() -> Finding:
    """Stamps are compared with those of the hand, so the clock must be about right and must not jump."""
    now = time.gmtime()
    text = time.strftime("%Y-%m-%d %H:%M:%S UTC", now)
    if now.tm_year < _YEAR_OF_RELEASE:
        return Finding("clock", "problem", text, "Set the clock, or let NTP do so")
    if ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES)) == _TIME_ERROR:
        todo = "Let NTP keep it (timedatectl set-ntp true); other machines' stamps are compared with it"
        return Finding("clock", "note", f"{text}; nothing keeps it right", todo)
    return Finding("clock", "ok", f"{text}, synchronised")


def _cores() -> Finding:
    count = len(os.sched_getaffinity(0))
    few = count < 2
    return Finding(
        "cores",
        "note" if few else "ok",
        f"{count}; no GPU is needed",
        "Calibration beside the live twin wants a second core" if few else "",
    )
