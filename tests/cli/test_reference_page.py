"""docs/cli.md lists every command and every option, as the program has them."""

from __future__ import annotations

import pytest

from twin_daemon.cli.app import COMMANDS, load
from twin_daemon.cli.reference_page import page


@pytest.fixture(scope="module")
def text() -> str:
    return page()


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_of_a_command_is_in_its_section(name: str, text: str) -> None:
    section = text.split(f"\n## `twin {name}`\n")[1].split("\n## ")[0]
    command = load(name)
    leaves = getattr(command, "commands", {"": command})
    for short, leaf in leaves.items():
        assert f"`twin {name} {short}`" in section or not short
        shown = [one for one in leaf.params if not getattr(one, "hidden", False)]
        assert all(option in section for one in shown for option in one.opts if option.startswith("--"))
