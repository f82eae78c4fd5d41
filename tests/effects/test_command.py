"""`twin effects` as a user types it."""

from __future__ import annotations

import json

import pytest

from twin_daemon.cli.app import main
from twin_daemon.effects import LIBRARY


def test_the_library_is_listed(capsys: pytest.CaptureFixture[str]):
    assert main(["effects", "--json", "-"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert listed["schema"] == 1
    assert [effect["key"] for effect in listed["effects"]] == list(LIBRARY)


@pytest.mark.parametrize("key", LIBRARY)
def test_one_effect_is_explained(key: str, capsys: pytest.CaptureFixture[str]):
    assert main(["effects", key]) == 0
    shown = capsys.readouterr().out
    assert LIBRARY[key].title in " ".join(shown.split())
    assert all(parameter.name in shown for parameter in LIBRARY[key].parameters)


@pytest.mark.parametrize(("typed", "meant"), [("stribek", "stribeck_friction"), ("backlsh", "backlash")])
def test_a_mistyped_key_is_answered_with_the_nearest(typed: str, meant: str, capsys: pytest.CaptureFixture[str]):
    assert main(["effects", typed]) == 3
    error = capsys.readouterr().err
    assert f"Did you mean '{meant}'?" in error
    assert error.count("\n") == 1
