"""Versions are found, moved between and exported; a damaged one harms no other."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import mujoco
import pytest

from twin_daemon.errors import BadInput
from twin_daemon.versions import Draft, VersionStore


def test_a_version_comes_back_as_it_was_stored(store: VersionStore, draft: Callable[..., Draft], mjcf: str) -> None:
    stored = store.add(draft(), mjcf, alias="candidate")
    assert store.get(stored.id) == store.get(stored.id[:8]) == store.get("candidate") == stored
    assert store.model("candidate") == mjcf
    assert store.list()[1:] == [stored]


def test_adding_the_same_again_stores_nothing_new(store: VersionStore, draft: Callable[..., Draft], mjcf: str) -> None:
    assert store.add(draft(), mjcf) == store.add(draft(), mjcf)
    assert len(store.list()[1:]) == 1


def test_versions_are_listed_in_the_order_they_were_made(
    store: VersionStore, draft: Callable[..., Draft], mjcf: str
) -> None:
    made = [store.add(draft(damping), mjcf).id for damping in (0.3, 0.1, 0.2)]
    assert [version.id for version in store.list()[1:]] == made


def test_an_empty_store_can_be_read_and_creates_nothing(store: VersionStore) -> None:
    assert [version.id for version in store.list()] == ["nominal"]
    assert store.current().id == "nominal"
    assert store.last_promoted() is None
    assert not store.root.exists()


@pytest.mark.parametrize("reference", ["previous", "candidate", "abcdef", "x"])
def test_what_is_not_there_is_bad_input(store: VersionStore, reference: str) -> None:
    with pytest.raises(BadInput):
        store.get(reference)


def test_promoting_and_rolling_back(store: VersionStore, draft: Callable[..., Draft], mjcf: str) -> None:
    first, second, third = (store.add(draft(damping), mjcf, alias="candidate").id for damping in (0.1, 0.2, 0.3))
    assert store.rollback().id == "nominal", "it is in use, and nothing was before it"
    store.promote(first)
    assert store.aliases() == {"current": first, "previous": "nominal", "candidate": third}
    assert store.rollback().id == "nominal"
    assert "previous" not in store.aliases()
    for reference in (first, second):
        store.promote(reference)
    assert store.promote().id == third
    assert store.promote(third).id == third  # again: nothing moves
    assert store.aliases() == {"current": third, "previous": second}
    assert store.rollback().id == second
    assert store.aliases() == {"current": second, "previous": first}
    assert store.rollback().id == first
    assert store.names(third) == [], "it was decided about: it is no candidate again"


def test_rolling_back_to_a_damaged_version_moves_nothing(
    store: VersionStore, draft: Callable[..., Draft], mjcf: str
) -> None:
    first, second = (store.promote(store.add(draft(damping), mjcf).id) for damping in (0.1, 0.2))
    damage(store.resolve(first.id).folder / "model.xml")
    with pytest.raises(BadInput, match=r"model\.xml"):
        store.rollback()
    assert store.aliases()["current"] == second.id


def test_previous_follows_by_itself(store: VersionStore, draft: Callable[..., Draft], mjcf: str) -> None:
    version = store.add(draft(), mjcf)
    store.set_alias("bench", version.id)
    assert store.get("bench") == version
    for alias in ("previous", "a/b", "", version.id):
        with pytest.raises(BadInput, match="cannot be set"):
            store.set_alias(alias, version.id)


def test_a_start_that_fits_several_names_them(store: VersionStore, draft: Callable[..., Draft], mjcf: str) -> None:
    ids = [store.add(draft(), mjcf).id]
    twin = store.resolve(ids[0]).folder.with_name(ids[0][:10] + "0" * 54)
    shutil.copytree(store.resolve(ids[0]).folder, twin)
    with pytest.raises(BadInput, match="several"):
        store.get(ids[0][:10])


def damage(path: Path) -> None:
    path.chmod(0o644)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize("name", ["version.json", "model.xml", "SHA256SUMS"])
@pytest.mark.parametrize("harm", [damage, lambda path: path.write_bytes(b""), Path.unlink])
def test_a_damaged_version_is_named_and_harms_no_other(
    name: str, harm: Callable[[Path], object], store: VersionStore, draft: Callable[..., Draft], mjcf: str
) -> None:
    good, bad = store.add(draft(0.1), mjcf), store.add(draft(0.2), mjcf)
    folder = store.resolve(bad.id).folder
    (folder / name).chmod(0o644)
    harm(folder / name)
    with pytest.raises(BadInput, match=str(folder)) as caught:
        store.get(bad.id)
    assert "delete" in caught.value.line()
    versions, problems = store.survey()
    assert versions[1:] == [good]
    assert len(problems) == 1
    assert store.add(draft(0.2), mjcf).id == bad.id  # the same content again puts it right
    assert store.survey()[1] == []


def test_numbers_changed_with_their_sums_are_found_by_the_id(
    store: VersionStore, draft: Callable[..., Draft], mjcf: str
) -> None:
    folder = store.resolve(store.add(draft(0.125), mjcf).id).folder
    for path in folder.iterdir():
        path.chmod(0o644)
    record = folder / "version.json"
    record.write_text(record.read_text(encoding="utf-8").replace("0.125", "0.5"), encoding="utf-8")
    sums = subprocess.run(["sha256sum", "version.json", "model.xml"], cwd=folder, capture_output=True, check=True)
    (folder / "SHA256SUMS").write_bytes(sums.stdout)
    assert "id stands for" in store.survey()[1][0]


def test_the_sums_are_those_of_plain_tools(store: VersionStore, draft: Callable[..., Draft], mjcf: str) -> None:
    folder = store.resolve(store.add(draft(), mjcf).id).folder
    subprocess.run(["sha256sum", "--check", "--strict", "SHA256SUMS"], cwd=folder, check=True, capture_output=True)


def test_damaged_names_leave_the_versions_readable(store: VersionStore, draft: Callable[..., Draft], mjcf: str) -> None:
    version = store.add(draft(), mjcf, alias="candidate")
    (store.root / "aliases.json").write_text("{", encoding="utf-8")
    assert store.get("candidate") == version, "the log of decisions says where the names point"
    (store.root / "log.jsonl").unlink()
    with pytest.raises(BadInput, match=r"aliases\.json"):
        store.get("candidate")
    assert store.list()[1:] == [version]


def test_a_version_of_another_hand_is_not_taken(
    store: VersionStore, tmp_path: Path, draft: Callable[..., Draft], mjcf: str
) -> None:
    version = store.add(draft(), mjcf)
    shutil.copytree(store.root, tmp_path / "other")
    other = VersionStore("other", root=tmp_path / "other", shipped=tmp_path / "none")
    with pytest.raises(BadInput, match="elsewhere"):
        other.get(version.id)


@pytest.mark.parametrize("hand", ["", "../up", "a/b", ".hidden"])
def test_a_hand_cannot_reach_out_of_the_state_folder(hand: str) -> None:
    with pytest.raises(BadInput, match="cannot name"):
        VersionStore(hand)


def test_shipped_versions_have_names_and_are_read_only(
    store: VersionStore, tmp_path: Path, draft: Callable[..., Draft], mjcf: str
) -> None:
    version = store.add(draft(), mjcf)
    shutil.copytree(store.resolve(version.id).folder, tmp_path / "shipped" / "bench-2024")
    fresh = VersionStore("hand", root=tmp_path / "fresh", shipped=tmp_path / "shipped")
    assert fresh.get("bench-2024") == version
    assert fresh.list()[1:] == [version]
    assert fresh.shipped(version.id)
    fresh.promote("bench-2024")
    assert fresh.current() == version
    assert fresh.names(version.id) == ["current", "bench-2024"]
    assert not (tmp_path / "fresh" / "versions" / version.id).exists()


def test_an_export_is_a_model_for_plain_mujoco(
    store: VersionStore, tmp_path: Path, draft: Callable[..., Draft], mjcf: str
) -> None:
    version = store.add(draft(), mjcf)
    store.export(version.id, tmp_path / "twin.xml")
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "twin.xml")).njnt == 1
    with pytest.raises(BadInput, match="does not exist"):
        store.export(version.id, tmp_path / "absent" / "twin.xml")


def test_a_model_that_mujoco_refuses_is_not_exported(
    store: VersionStore, tmp_path: Path, draft: Callable[..., Draft]
) -> None:
    version = store.add(draft(), "<mujoco><wurldbody/></mujoco>")
    with pytest.raises(BadInput, match="MuJoCo does not load"):
        store.export(version.id, tmp_path / "twin.xml")
    assert not (tmp_path / "twin.xml").exists()


def judged(
    draft: Callable[..., Draft], damping: float, held_out: tuple[float, float], on: str = "b", **more: object
) -> Draft:
    used = {"fitted_on": [{"name": "a", "sha256": "a"}], "held_out_on": [{"name": on, "sha256": on}]}
    before, after = ({"mse_rad2": value} for value in held_out)
    return draft(damping, **used, errors={"holdout_before": before, "holdout_after": after}, **more)


def test_what_is_not_better_on_held_out_motion_is_no_candidate(
    store: VersionStore, draft: Callable[..., Draft], mjcf: str
) -> None:
    good = store.propose(judged(draft, 0.1, (2e-5, 1e-5)), mjcf)
    assert good.candidate
    for worse in (judged(draft, 0.2, (2e-5, 2e-5)), judged(draft, 0.3, (2e-5, 3e-5))):
        kept = store.propose(worse, mjcf)
        assert not kept.candidate
        assert store.get(kept.version.id) == kept.version
    assert store.get("candidate") == good.version
    assert store.propose(draft(0.4), mjcf).candidate, "nothing was held out"


def test_promoting_a_worse_version_needs_force_and_a_reason(
    store: VersionStore, draft: Callable[..., Draft], mjcf: str
) -> None:
    first = store.add(judged(draft, 0.1, (1e-3, 1e-5)), mjcf)
    child = store.add(judged(draft, 0.2, (1e-5, 4e-5), parent=first.id), mjcf)
    sibling = store.add(judged(draft, 0.3, (1e-3, 2e-5)), mjcf)
    elsewhere = store.add(judged(draft, 0.4, (1e-3, 9e-4), on="c"), mjcf)
    than_nominal = store.add(judged(draft, 0.5, (1e-3, 2e-3)), mjcf)
    with pytest.raises(BadInput, match=r"worse than nominal.*0\.002 rad² against 0\.001 rad² on held-out motion of b"):
        store.promote(than_nominal.id)
    store.promote(first.id)
    for worse in (child, sibling):
        with pytest.raises(BadInput, match="--force --reason"):
            store.promote(worse.id)
    with pytest.raises(BadInput, match="--reason"):
        store.promote(child.id, force=True, reason=" ")
    assert store.aliases()["current"] == first.id
    store.promote(child.id, force=True, reason="the bench needs it")
    assert store.decisions().last is not None
    assert "the bench needs it" in store.notes()[child.id][0].text
    assert "although worse" in store.notes()[child.id][0].text
    assert store.promote(elsewhere.id, reason="another bench").id == elsewhere.id, "nothing is known of both"
    assert store.promote("nominal").id == "nominal", "where every way back ends"
