"""`twin versions` with the real hand and a real state folder."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import mujoco
import pytest

from twin_daemon.cli.app import main
from twin_daemon.versions import Draft, Version, VersionStore


@pytest.fixture
def versions(state_dir: Path, draft: Callable[..., Draft], mjcf: str) -> list[Version]:
    store = VersionStore("shadow_hand")
    assert store.root.is_relative_to(state_dir)
    titles = ("[bold]bench[/bold]", "after the new tendon")
    return [
        store.add(draft(0.1 + n, hand="shadow_hand", title=title), mjcf, alias="candidate")
        for n, title in enumerate(titles)
    ]


def answer(capsys: pytest.CaptureFixture[str], *argv: str, code: int = 0) -> dict:
    assert main(["versions", *argv, "--json", "-"]) == code
    result = json.loads(capsys.readouterr().out)
    assert result["schema"] == 1
    return result


def test_the_story_of_two_versions(versions: list[Version], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, second = (version.id for version in versions)
    listed = answer(capsys, "list")
    assert [row["id"] for row in listed["versions"] if not row["shipped"]] == [first, second]
    assert answer(capsys, "promote", first[:12])["current"] == first
    assert answer(capsys, "promote") == {"schema": 1, "current": second, "previous": first, "version": second}
    shown = answer(capsys, "show")
    assert shown["id"] == second
    assert shown["parameters"]["FFJ3.damping"]["unit"] == "N m s/rad"
    assert answer(capsys, "diff", "previous", "current")["differences"]["parameters"][0]["ratio"] == pytest.approx(11)
    assert answer(capsys, "rollback")["current"] == first
    exported = answer(capsys, "export", second[:8], "-o", str(tmp_path / "twin.xml"))
    assert exported["version"] == second
    assert mujoco.MjModel.from_xml_path(exported["path"]).njnt == 1
    assert {first, second} <= set(answer(capsys, "verify")["intact"])


def test_people_see_titles_as_they_were_written(
    versions: list[Version], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["versions", "list"]) == 0
    shown = capsys.readouterr().out
    assert "[bold]bench[/bold]" in shown
    assert all(version.short_id in shown for version in versions)


def test_a_damaged_version_ends_verify_with_3(versions: list[Version], capsys: pytest.CaptureFixture[str]) -> None:
    model = VersionStore("shadow_hand").resolve(versions[0].id).folder / "model.xml"
    model.chmod(0o644)
    model.write_text("<mujoco/>", encoding="utf-8")
    result = answer(capsys, "verify", code=3)
    assert versions[1].id in result["intact"]
    assert str(model) in result["problems"][0]


@pytest.mark.parametrize("argv", [["promote", "nonsense"], ["rollback"], ["show"], ["diff", "current", "candidate"]])
def test_what_cannot_be_done_is_bad_input(argv: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["versions", *argv]) == 3
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
