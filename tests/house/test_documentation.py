"""What can be called is explained to people."""

from __future__ import annotations

from pathlib import Path

import pytest

from twin_daemon.cli.app import COMMANDS

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_is_documented(name: str) -> None:
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    assert any(f"twin {name}" in page.read_text(encoding="utf-8") for page in pages)


def test_the_readme_names_the_two_commands_and_the_tests() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert all(command in readme for command in ("make setup", "make demo", "make test"))
