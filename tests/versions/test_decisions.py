"""What was decided is logged in order, older folders are taken over, and a newer release's are left alone."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from twin_daemon.errors import BadInput
from twin_daemon.versions import Draft, Version, VersionStore
from twin_daemon.versions.verify import verify

Make = Callable[..., Draft]


@pytest.fixture
def three(store: VersionStore, draft: Make, mjcf: str) -> list[Version]:
    return [store.add(draft(damping), mjcf, alias="candidate") for damping in (0.1, 0.2, 0.3)]


def as_layout_1(store: VersionStore, promoted: list[str], names: dict[str, str]) -> None:
    """What an earlier release left: names, and no log."""
    for path in (store.root / "log.jsonl", store.root / "index.sqlite"):
        path.unlink(missing_ok=True)
    content = {"schema": 1, "promoted": promoted, "names": names}
    (store.root / "aliases.json").write_text(json.dumps(content), encoding="utf-8")


def test_a_candidate_is_one_until_it_is_decided_about(store: VersionStore, three: list[Version]) -> None:
    assert store.get("candidate") == three[2]
    store.promote(three[1].id)
    assert store.get("candidate") == three[2], "another one was promoted"
    assert store.reject() == three[2]
    with pytest.raises(BadInput, match="decided about"):
        store.get("candidate")
    assert store.get(three[2].id) == three[2]


def test_a_late_rollback_moves_nothing(store: VersionStore, three: list[Version]) -> None:
    for version in three[:2]:
        store.promote(version.id)
    with pytest.raises(BadInput, match="not current any more"):
        store.rollback(expected=three[0].id)
    assert store.rollback(expected=three[1].id) == three[0]


def test_notes_stand_beside_a_version_that_never_changes(store: VersionStore, three: list[Version]) -> None:
    before = store.resolve(three[0].id).folder.stat().st_mtime_ns
    store.note(three[0].id[:8], "new tendon [FF]")
    store.note(three[0].id, "  greased ")
    assert [note.text for note in store.notes()[three[0].id]] == ["new tendon [FF]", "greased"]
    assert store.resolve(three[0].id).folder.stat().st_mtime_ns == before
    with pytest.raises(BadInput, match="words"):
        store.note(three[0].id, " ")


def test_a_name_of_ones_own_comes_and_goes(store: VersionStore, three: list[Version]) -> None:
    store.set_alias("bench", three[0].id)
    assert store.remove_alias("bench") == three[0].id
    assert "bench" not in store.aliases()
    with pytest.raises(BadInput, match="called"):
        store.remove_alias("bench")


def test_an_earlier_layout_is_taken_over(store: VersionStore, three: list[Version]) -> None:
    first, second, third = (version.id for version in three)
    as_layout_1(store, [first, second], {"candidate": second, "bench": first})
    assert store.aliases() == {"current": second, "previous": first, "bench": first}, "reading changes nothing"
    assert not (store.root / "log.jsonl").exists()
    store.promote(third)
    assert store.aliases() == {"current": third, "previous": second, "bench": first}
    assert [decision.what for decision in store.decisions().decisions] == ["checkpoint", "promoted"]
    assert [version.id for version in store.list()[1:]] == [first, second, third]
    (store.root / "aliases.json").unlink()
    assert store.aliases() == {"current": third, "previous": second, "bench": first}, "the log alone says it"
    assert verify(store).problems == ()


def test_a_version_of_a_newer_release_is_refused_with_words(store: VersionStore, three: list[Version]) -> None:
    from hashlib import sha256

    folder = store.resolve(three[0].id).folder
    for path in folder.iterdir():
        path.chmod(0o644)
    content = json.loads((folder / "version.json").read_bytes()) | {"schema": 7, "wear": 0.5}
    record = json.dumps(content).encode()
    (folder / "version.json").write_bytes(record)
    model = (folder / "model.xml").read_bytes()
    sums = f"{sha256(record).hexdigest()}  version.json\n{sha256(model).hexdigest()}  model.xml\n"
    (folder / "SHA256SUMS").write_text(sums, encoding="ascii")
    with pytest.raises(BadInput, match=r"newer release \(schema 7\).*schema 1 to 1.*Update the package"):
        store.get(three[0].id)
    assert [version.id for version in store.list()[1:]] == [version.id for version in three[1:]]


@pytest.mark.parametrize("name", ["aliases.json", "log.jsonl"])
def test_a_store_of_a_newer_release_is_not_written(store: VersionStore, three: list[Version], name: str) -> None:
    store.promote(three[0].id)
    path = store.root / name
    content = path.read_text(encoding="utf-8")
    path.write_text(
        content.replace('"schema": 3', '"schema": 4').replace('"schema": 2', '"schema": 3'), encoding="utf-8"
    )
    before = path.read_bytes()
    with pytest.raises(BadInput, match="newer release"):
        store.promote(three[1].id)
    assert path.read_bytes() == before


def test_a_torn_last_line_was_never_said_and_goes(store: VersionStore, three: list[Version]) -> None:
    path = store.root / "log.jsonl"
    whole = path.read_bytes()
    path.write_bytes(whole + b'{"schema": 2, "sequence": 4, "wh')
    assert len(store.decisions().decisions) == 3
    assert verify(store).problems == ()
    assert path.read_bytes() == whole


def test_a_decision_whose_names_did_not_follow_is_finished(store: VersionStore, three: list[Version]) -> None:
    names = (store.root / "aliases.json").read_bytes()
    store.promote(three[0].id)
    (store.root / "aliases.json").write_bytes(names)  # as if the process had died between the two
    assert store.aliases()["current"] == "nominal"
    store.note(three[1].id, "next")
    assert store.aliases()["current"] == three[0].id


def test_a_changed_line_is_found_and_can_be_left_out(store: VersionStore, three: list[Version]) -> None:
    store.promote(three[0].id)
    store.note(three[0].id, "kept")
    path = store.root / "log.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    path.write_text("".join(lines).replace("promoted", "rejected"), encoding="utf-8")
    (problem,) = verify(store).problems
    assert "line 4" in problem
    mended = verify(store, rebuild=True)
    assert (mended.problems, len(mended.mended)) == ((), 1)
    assert store.aliases() == {"current": three[0].id, "previous": "nominal", "candidate": three[2].id}
    assert store.notes()[three[0].id][0].text == "kept"
    path.write_text("".join(path.read_text(encoding="utf-8").splitlines(keepends=True)[1:]), encoding="utf-8")
    assert "missing" in verify(store).problems[0]


def test_a_version_that_is_gone_is_missed_until_that_is_accepted(store: VersionStore, draft: Make, mjcf: str) -> None:
    import shutil

    parent = store.add(draft(0.1), mjcf)
    child = store.promote(store.add(draft(0.2, parent=parent.id), mjcf).id)
    shutil.rmtree(store.resolve(parent.id).folder)
    problems = verify(store).problems
    assert any("was stored and is gone" in problem for problem in problems)
    assert any("was made from" in problem for problem in problems)
    assert verify(store, rebuild=True).problems == ()
    shutil.rmtree(store.resolve(child.id).folder)
    assert any("'current' points at" in problem for problem in verify(store, rebuild=True).problems)


def test_a_folder_that_a_dead_writer_left_unlogged_is_taken_up(
    store: VersionStore, three: list[Version], draft: Make, mjcf: str, tmp_path: Path
) -> None:
    import shutil

    other = VersionStore("hand", root=tmp_path / "other", shipped=tmp_path / "none")
    version = other.add(draft(0.9), mjcf)
    shutil.copytree(other.resolve(version.id).folder, store.contents.folders / version.id)
    assert verify(store).problems == ()
    assert store.decisions().last is not None
    assert store.decisions().last.version == version.id
    assert store.list()[-1] == version
