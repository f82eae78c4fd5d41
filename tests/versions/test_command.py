"""`twin versions` with the real hand and a real state folder."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import mujoco
import pytest

from twin_daemon.cli.app import main
from twin_daemon.hand import load_hand
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import Draft, Version, VersionStore

Capture = pytest.CaptureFixture[str]


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


def test_nominal_is_a_version_like_any_other(
    versions: list[Version], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, second = (version.id for version in versions)
    row = answer(capsys, "list")["versions"][0]
    assert (row["id"], row["kind"], row["names"], row["created"]) == (
        "nominal",
        "nominal",
        ["nominal", "current"],
        None,
    )
    assert answer(capsys, "show")["terms"]["effects"] == []
    change = answer(capsys, "diff", "nominal", first)["differences"]["parameters"][0]
    assert (change["before"], change["after"]) == (None, 0.1)
    exported = answer(capsys, "export", "nominal", "-o", str(tmp_path / "nominal.xml"))
    assert mujoco.MjModel.from_xml_path(exported["path"]).nu == TwinModel.load(load_hand()).model.nu
    # the first promotion can be taken back, and the nominal model put in use by itself
    assert answer(capsys, "promote", second)["previous"] == "nominal"
    assert answer(capsys, "rollback")["current"] == "nominal"
    assert answer(capsys, "rollback")["version"] == "nominal", "there is always somewhere to go"
    for reference in (first, "nominal"):
        assert answer(capsys, "promote", reference)["current"] == reference
    assert answer(capsys, "rollback")["current"] == first
    assert answer(capsys, "verify")["problems"] == []
    assert answer(capsys, "note", "nominal", "as delivered")["notes"][0]["text"] == "as delivered"
    assert main(["versions", "name", "nominal", first]) == 3
    assert main(["versions", "list", "--tree"]) == 0
    tree = capsys.readouterr().out.splitlines()
    nominal, child = (next(line.index(name) for line in tree if name in line) for name in ("nominal", first[:12]))
    assert nominal < child


def test_a_worse_version_is_promoted_by_force_and_with_a_reason_alone(
    state_dir: Path, draft: Callable[..., Draft], mjcf: str, capsys: pytest.CaptureFixture[str]
) -> None:
    errors = {"holdout_before": {"mse_rad2": 1e-5}, "holdout_after": {"mse_rad2": 2e-5}}
    used = {"held_out_on": [{"name": "closing.csv", "sha256": "b"}], "errors": errors}
    worse = VersionStore("shadow_hand").propose(draft(0.2, hand="shadow_hand", **used), mjcf)
    assert not worse.candidate
    assert main(["versions", "promote", worse.version.id]) == 3
    assert "closing.csv" in capsys.readouterr().err
    assert main(["versions", "promote", worse.version.id, "--force"]) == 2
    capsys.readouterr()
    moved = answer(capsys, "promote", worse.version.id, "--force", "--reason", "for the bench")
    assert moved["current"] == worse.version.id
    assert moved["worse"]["mse_rad2"] == 2e-5
    assert "for the bench" in answer(capsys, "show")["notes"][0]["text"]


@pytest.fixture
def added(draft: Callable[..., Draft], mjcf: str) -> Callable[..., Version]:
    """Adds a version to those of the hand."""
    return lambda damping, **more: VersionStore("shadow_hand").add(draft(damping, hand="shadow_hand", **more), mjcf)


@pytest.fixture
def columns(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Makes the terminal so wide."""
    return lambda count: monkeypatch.setenv("COLUMNS", str(count))


def test_the_list_fits_a_narrow_terminal(
    versions: list[Version], added: Callable[..., Version], capsys: Capture, columns: Callable[[int], None]
) -> None:
    columns(80)
    title = "ladder: " + ", ".join(f"stribeck_friction at rh_{finger}J3" for finger in ("FF", "MF", "RF", "LF", "TH"))
    added(0.9, title=title)
    listed = len(answer(capsys, "list")["versions"])
    assert main(["versions", "list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 + 2 * listed
    assert max(map(len, lines)) <= 80
    assert all(version.short_id in "".join(lines) for version in versions)


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


def test_the_store_is_kept_from_the_command_line(
    versions: list[Version], tmp_path: Path, state_dir: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, second = (version.id for version in versions)
    assert answer(capsys, "note", first, "greased")["notes"][0]["text"] == "greased"
    assert answer(capsys, "name", "bench", first)["aliases"] == {
        "current": "nominal",
        "candidate": second,
        "bench": first,
    }
    for reference in (first, second):
        answer(capsys, "promote", reference)
    rows = {row["id"]: row for row in answer(capsys, "list")["versions"]}
    assert rows[first]["notes"][0]["text"] == "greased"
    plots = [tmp_path / "history.html", tmp_path / "diff.html"]
    told = answer(capsys, "history", "--parameter", "FFJ3.damping", "--plot", str(plots[0]))
    assert [point["value"] for point in told["parameters"]["FFJ3.damping"]["points"]] == [0.1, 1.1]
    assert {promotion["version"] for promotion in told["promotions"]} == {first, second}
    assert told["parameters"]["FFJ3.damping"]["lifetime"] == "", "it was there all along"
    answer(capsys, "diff", first, second, "--plot", str(plots[1]))
    assert all("FFJ3" in plot.read_text(encoding="utf-8") for plot in plots)
    file = tmp_path / "versions.tar"
    assert answer(capsys, "backup", str(file))["hands"] == {"shadow_hand": [first, second]}
    assert answer(capsys, "prune", "--keep", "0", "--older-than", "0", "--dry-run")["frees_bytes"] == 0
    assert answer(capsys, "prune")["dry_run"] is False
    shutil.rmtree(state_dir)
    assert answer(capsys, "restore", str(file))["hands"][0]["how"] == "restored"
    assert answer(capsys, "name", "bench")["aliases"] == {"current": second, "previous": first}
    verified = answer(capsys, "verify", "--rebuild")
    assert (verified["problems"], verified["index"]) == ([], "rebuilt")


def test_the_tree_shows_who_came_from_whom(
    versions: list[Version], added: Callable[..., Version], capsys: Capture, columns: Callable[[int], None]
) -> None:
    columns(200)
    child = added(0.7, parent=versions[0].id)
    assert main(["versions", "list", "--tree"]) == 0
    lines = capsys.readouterr().out.splitlines()
    where = {v.id: next(line.index(v.short_id) for line in lines if v.short_id in line) for v in (*versions, child)}
    assert where[child.id] > where[versions[0].id] == where[versions[1].id]


def test_a_rejected_candidate_waits_no_more(versions: list[Version], capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(capsys, "reject") == {"schema": 1, "version": versions[1].id, "aliases": {"current": "nominal"}}
    assert main(["versions", "promote"]) == 3
    assert "decided about" in capsys.readouterr().err


@pytest.mark.parametrize(
    "argv",
    [
        ["promote", "nonsense"],
        ["show", "previous"],
        ["diff", "current", "candidate"],
        ["history"],
        ["reject"],
        ["note", "nonsense", "words"],
        ["prune", "--ancestors", "gone"],
        ["backup", "/nowhere/at/all.tar"],
        ["restore", "/nowhere/at/all.tar"],
    ],
)
def test_what_cannot_be_done_is_bad_input(argv: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["versions", *argv]) == 3
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
