"""Options that take several values, and those that several commands share."""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path
from typing import Annotated

import pytest
import typer

import twin_daemon.cli
from twin_daemon.cli.command import expand, single
from twin_daemon.cli.failures import guarded
from twin_daemon.cli.options import Holdouts, Recordings, settings
from twin_daemon.errors import UsageError

SEVERAL = {"--recording", "--holdout"}


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ("--recording a b c", "--recording a --recording b --recording c"),
        ("--recording a --recording b", "--recording a --recording b"),
        ("--recording a b --holdout c d", "--recording a --recording b --holdout c --holdout d"),
        ("--recording a --seed 3 rest", "--recording a --seed 3 rest"),
        ("--recording a -- b", "--recording a -- b"),
        ("--recording=a b", "--recording=a b"),
        ("first --recording a", "first --recording a"),
        ("--recording a - b", "--recording a --recording - --recording b"),
        ("--recording", "--recording"),
    ],
)
def test_values_end_at_the_next_option(given: str, meant: str) -> None:
    assert expand(given.split(), SEVERAL) == meant.split()


def test_a_command_gets_every_value() -> None:
    seen = {}

    def command(
        key: Annotated[str, typer.Argument()], recording: Recordings, holdout: Holdouts = None, fast: bool = False
    ) -> None:
        seen.update(key=key, recording=recording, holdout=holdout, fast=fast)

    assert guarded(single("try", command), ["stribeck", "--recording", "a", "b", "--fast", "--holdout", "c"]) == 0
    assert seen == {"key": "stribeck", "recording": [Path("a"), Path("b")], "holdout": [Path("c")], "fast": True}


def test_settings_are_numbers_by_name() -> None:
    assert settings(["breakaway=0.02", "speed=1e-3"]) == {"breakaway": 0.02, "speed": 0.001}
    assert settings(None) == {}


@pytest.mark.parametrize("pair", ["breakaway", "breakaway=", "=1", "breakaway=much"])
def test_a_setting_that_is_none_is_wrong_usage(pair: str) -> None:
    with pytest.raises(UsageError, match="name=value"):
        settings([pair])


def test_an_option_that_several_commands_have_is_written_down_once() -> None:
    written: Counter[str] = Counter()
    for path in Path(twin_daemon.cli.__path__[0]).glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in ("typer.Option", "typer.Argument"):
                written[ast.unparse(node)] += 1
    assert sum(written.values()) > 50
    assert [text for text, times in written.items() if times > 1] == []
