"""The command line answers at once, as help loads nothing that computes or talks to a network; a daemon soon."""

from __future__ import annotations

import subprocess
import sys

import pytest

from twin_daemon.cli.app import COMMANDS, main

HEAVY = {"mujoco", "numpy", "scipy", "sklearn", "skopt", "zenoh", "rosbags", "plotly", "rclpy", "apscheduler"}


def test_help_loads_nothing_heavy() -> None:
    code = "import sys; from twin_daemon.cli.app import main; main(['--help']); print('|', *sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    shown, loaded = done.stdout.rsplit("|", 1)
    assert "versions" in shown
    assert not HEAVY & {name.partition(".")[0] for name in loaded.split()}


@pytest.mark.parametrize("module", ["bridges.zenoh.daemon", "bridges.zenoh.gatekeeper"])
def test_what_lives_with_the_hand_starts_without_an_optimiser(module: str) -> None:
    """Each process of a hand would begin half a second later."""
    code = f"import sys, {module}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert module in done.stdout
    assert "scipy.optimize" not in done.stdout


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_explains_itself(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([name, "--help"]) == 0
    assert f"twin {name}" in capsys.readouterr().out


def test_the_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("twin ")
