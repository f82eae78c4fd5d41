"""What can be called is explained to people."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from twin_daemon import api
from twin_daemon.api import reference_page as of_api
from twin_daemon.cli import reference_page as of_commands
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


def test_the_story_of_the_readme_is_that_of_the_tutorial_which_is_run() -> None:
    readme, tutorial = ((ROOT / page).read_text(encoding="utf-8") for page in ("README.md", "docs/tutorial.md"))
    story = re.findall(r"^twin .+$", readme, flags=re.M)
    assert len(story) == 6
    assert all(re.search(rf"^{re.escape(command)}( |$)", tutorial, flags=re.M) for command in story)


@pytest.mark.parametrize("page", ["safety.md", "security.md", "hazards.md"])
def test_the_tests_that_a_page_names_exist(page: str) -> None:
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    for path, name in re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", text):
        assert (ROOT / path).is_file(), path
        assert not name or f"def {name}(" in (ROOT / path).read_text(encoding="utf-8"), f"{path}::{name}"


@pytest.mark.parametrize(
    ("page", "last"), [("safety.md", "test,"), ("security.md", "test"), ("hazards.md", "shown by")]
)
def test_each_row_of_what_is_tested_names_its_test(page: str, last: str) -> None:
    tables = (ROOT / "docs" / page).read_text(encoding="utf-8").split("\n\n")
    rows = [
        cells[-1]
        for table in tables
        if re.search(rf"\| {last}[^|]*\|\n\|-", table)
        for cells in (re.split(r"(?<!\\)\|", row.strip().strip("|")) for row in table.strip().splitlines()[2:])
    ]
    assert len(rows) >= 10
    assert all("`tests/" in row for row in rows), [row for row in rows if "`tests/" not in row]
    names = re.findall(r"`((?:tests/)?[\w/]*test_\w+\.py)", "".join(rows))
    assert all(name.startswith("tests/") for name in names), names


@pytest.mark.parametrize(
    ("name", "made", "command"),
    [
        ("cli.md", of_commands.page, "twin config cli -o docs/cli.md"),
        ("api.md", of_api.page, "python -m twin_daemon.api.reference_page docs/api.md"),
    ],
)
def test_a_reference_is_what_the_code_has(name: str, made: Callable[[], str], command: str) -> None:
    stored = (ROOT / "docs" / name).read_text(encoding="utf-8")
    assert stored == made(), f"'{command}' makes the page anew"


def test_the_reference_explains_all_of_the_api() -> None:
    text = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    for name in api.__all__:
        heading = f"### `{name}`" if isinstance(getattr(api, name), type) else f"### `td.{name}`"
        assert heading in text or name == "Result", name
    unexplained = re.findall(r"^\| `(\w+)` \| [^|]+ \|  \|$", text, flags=re.M)
    assert not unexplained, "a string after a field says what it is"
