"""What can be called is explained to people."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from twin_daemon.cli.app import COMMANDS

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_is_told_of_beside_its_reference(name: str) -> None:
    pages = [ROOT / "README.md", *(page for page in (ROOT / "docs").rglob("*.md") if page.name != "cli.md")]
    assert any(f"twin {name}" in page.read_text(encoding="utf-8") for page in pages)


def test_the_readme_names_the_two_commands_and_the_tests() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert all(command in readme for command in ("make setup", "make demo", "make test"))
    assert len(readme.splitlines()) <= 120


@pytest.mark.parametrize("page", ["safety.md", "security.md", "hazards.md"])
def test_the_tests_that_a_page_names_exist(page: str) -> None:
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    for path, name in re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", text):
        assert (ROOT / path).is_file(), path
        assert not name or f"def {name}(" in (ROOT / path).read_text(encoding="utf-8"), f"{path}::{name}"
