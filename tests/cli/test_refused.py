"""What cannot be used ends with 3 and one line, and nothing is left behind."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.test_offline import bag, space
from twin_daemon.cli.app import main

__all__ = ["bag", "space"]

FIT = ["calibrate", "--budget", "5"]
FILES = {
    "broken.yaml": "{",
    "broken.xml": "<mujoco><worldbody><body>",
    "unphysical.yaml": "schema: 1\nparameters: {rh_FFJ3.frictionloss: -0.1}\n",
    "unknown_joint.yaml": "schema: 1\nparameters: {rh_FFJ9.damping: 0.1}\n",
    "unknown_effect.yaml": "schema: 1\neffects: [{effect: stribek, target: rh_FFJ3}]\n",
    "unknown_key.yaml": "schema: 1\nparametres: {}\n",
    "unsearchable.yaml": "schema: 1\nname: x\nabout: x\nparameters: [{kind: damping, of: [moving], lower: -1}]\n",
    "no_bag.mcap": "this is not a bag",
    "hand.yaml": "schema: 1\nname: [\n",
    "entities.xml": '<!DOCTYPE m [<!ENTITY a "x"><!ENTITY b "&a;&a;&a;&a;">]><mujoco model="&b;"/>',
    "climbs.xml": '<mujoco><include file="../../../../etc/passwd"/></mujoco>',
    "aliases.yaml": "\n".join(
        ["a0: &a0 [x]", *(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 9))]
    ),
}
CASES: dict[str, tuple[list[str], str]] = {
    "no such recording": (["compare", "--recording", "nowhere.mcap"], "nowhere.mcap"),
    "not a recording": (["compare", "--recording", "no_bag.mcap"], "no_bag.mcap"),
    "unreadable terms": (["compare", "--recording", "BAG", "--terms", "broken.yaml"], "broken.yaml"),
    "negative friction": (["compare", "--recording", "BAG", "--terms", "unphysical.yaml"], "not physical"),
    "unknown joint": (["compare", "--recording", "BAG", "--terms", "unknown_joint.yaml"], "rh_FFJ9"),
    "unknown effect": (["compare", "--recording", "BAG", "--terms", "unknown_effect.yaml"], "stribek"),
    "unknown key": (["compare", "--recording", "BAG", "--terms", "unknown_key.yaml"], "parametres"),
    "unknown version": (["compare", "--recording", "BAG", "--version", "abcdef012345"], "abcdef012345"),
    "unknown hand": (["compare", "--recording", "BAG", "--hand", "shadow_hnad"], "Did you mean 'shadow_hand'"),
    "unreadable hand": (["compare", "--recording", "BAG", "--hand", "hand.yaml"], "hand.yaml"),
    "model that is not there": (["compare", "--recording", "BAG", "--model", "none.xml"], "none.xml"),
    "model that does not compile": (["compare", "--recording", "BAG", "--model", "broken.xml"], "broken.xml"),
    "model with entities": (["compare", "--recording", "BAG", "--model", "entities.xml"], "entities"),
    "model that climbs out": (["compare", "--recording", "BAG", "--model", "climbs.xml"], "outside its folder"),
    "terms that multiply": (["compare", "--recording", "BAG", "--terms", "aliases.yaml"], "aliases"),
    "unknown trajectory": (["compare", "--recording", "STILL", "--trajectory", "hand_closin"], "hand_closin"),
    "no commands, no trajectory": (["compare", "--recording", "STILL"], "--trajectory"),
    "folder of the plot": (["compare", "--recording", "BAG", "--plot", "none/x.html"], "folder does not exist"),
    "unknown space": ([*FIT, "--recording", "BAG", "--space", "phisical"], "Did you mean 'physical'"),
    "unreadable space": ([*FIT, "--recording", "BAG", "--space", "broken.yaml"], "broken.yaml"),
    "unphysical space": ([*FIT, "--recording", "BAG", "--space", "unsearchable.yaml"], "not physical"),
    "unknown search": ([*FIT, "--recording", "BAG", "--search", "leastsquares"], "Did you mean 'least-squares'"),
    "space of joints that are still": ([*FIT, "--recording", "BAG", "--space", "thumb"], "thumb"),
    "no such holdout": ([*FIT, "--recording", "BAG", "--holdout", "nowhere.csv"], "nowhere.csv"),
}


@pytest.mark.parametrize(("argv", "says"), CASES.values(), ids=CASES)
def test_it_ends_with_three_and_one_line(
    argv: list[str],
    says: str,
    bag: Path,
    still: Path,
    tmp_path: Path,
    state_dir: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.iterdir())
    words = {"BAG": str(bag), "STILL": str(still)}
    assert main([words.get(word, word) for word in argv]) == 3
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert says in captured.err
    assert sorted(p for p in tmp_path.iterdir() if p != state_dir) == before
    assert not [p for p in state_dir.rglob("*") if p.is_file()]


@pytest.fixture(scope="session")
def still(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of one joint, at 125 Hz and without commands."""
    rows = [f'"[\'rh_FFJ3\']","(0.1,)","(0.0,)","(0.0,)",{n * 8_000_000}' for n in range(500)]
    path = tmp_path_factory.mktemp("csv") / "still.csv"
    path.write_text("\n".join(["name,position,velocity,effort,timestamp_nsecs", *rows]) + "\n")
    return path


@pytest.mark.parametrize(
    "argv",
    [["compare"], ["calibrate", "--recording", "x", "--budget", "0"], ["calibrate", "--recording", "x", "--seed", "a"]],
)
def test_a_call_that_means_nothing_ends_with_two(argv: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(argv) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_version_and_terms_exclude_each_other(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", "--recording", str(bag), "--version", "current", "--terms", "x.yaml"]) == 2
    assert "exclude each other" in capsys.readouterr().err


def test_a_json_without_a_folder_stores_nothing(
    bag: Path, space: str, state_dir: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = [*FIT, "--recording", str(bag), "--space", space, "--json", "/nowhere/at/all.json"]
    assert main(argv) == 3
    assert not [p for p in state_dir.rglob("*") if p.is_file()]
    assert capsys.readouterr().err.count("\n") == 1
