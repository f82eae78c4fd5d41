"""A backup is one plain file, and a restore never overwrites silently."""

from __future__ import annotations

import shutil
import subprocess
import tarfile
from collections.abc import Callable
from pathlib import Path

import pytest

from twin_daemon.errors import BadInput
from twin_daemon.versions import Draft, Version, VersionStore
from twin_daemon.versions.archive import back_up, hands_with_versions, restore
from twin_daemon.versions.prune import Policy, prune
from twin_daemon.versions.verify import verify

Make = Callable[..., Draft]


@pytest.fixture(scope="module")
def two_hands(tmp_path_factory: pytest.TempPathFactory, draft: Make, mjcf: str) -> tuple[Path, dict[str, list[str]]]:
    """(a state folder with two hands, the ids of their versions)."""
    folder, made = tmp_path_factory.mktemp("two-hands") / "state", {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TWIN_STATE_DIR", str(folder))
        for hand in ("left", "right"):
            store = VersionStore(hand)
            made[hand] = [store.add(draft(0.1 * n, hand=hand), mjcf, alias="candidate").id for n in (1, 2, 3)]
            store.promote(made[hand][0])
            store.promote(made[hand][1])
            store.note(made[hand][0], "new tendon")
    return folder, made


@pytest.fixture
def hands(two_hands: tuple[Path, dict[str, list[str]]], state_dir: Path) -> dict[str, list[Version]]:
    """Two hands in the state folder."""
    folder, made = two_hands
    shutil.copytree(folder, state_dir, dirs_exist_ok=True)
    return {hand: [VersionStore(hand).get(version) for version in ids] for hand, ids in made.items()}


def backed_up(path: Path) -> Path:
    back_up([VersionStore(name) for name in hands_with_versions()], path)
    return path


def state_of(hand: str) -> tuple:
    store = VersionStore(hand)
    return store.list(), store.aliases(), store.notes(), verify(store).problems


def test_everything_comes_back_on_an_empty_machine(
    hands: dict[str, list[Version]], tmp_path: Path, state_dir: Path
) -> None:
    before = {hand: state_of(hand) for hand in hands}
    file = backed_up(tmp_path / "backup.tar")
    shutil.rmtree(state_dir)
    assert {one.hand: one.how for one in restore(file)} == {"left": "restored", "right": "restored"}
    assert {hand: state_of(hand) for hand in hands} == before
    assert {one.how for one in restore(file)} == {"unchanged"}, "a second time nothing is left to do"
    assert not list((state_dir / "hands").glob(".restore*"))


def test_the_rest_of_a_hands_folder_is_left_alone(hands: dict, tmp_path: Path, state_dir: Path) -> None:
    file = backed_up(tmp_path / "backup.tar")
    shutil.rmtree(state_dir)
    events = state_dir / "hands" / "left" / "events.jsonl"
    events.parent.mkdir(parents=True)
    events.write_text("{}\n", encoding="utf-8")
    restore(file)
    assert events.read_text(encoding="utf-8") == "{}\n"
    assert verify(VersionStore("left")).problems == ()


def test_plain_tools_can_check_it(hands: dict, tmp_path: Path) -> None:
    file = backed_up(tmp_path / "backup.tar")
    (tmp_path / "out").mkdir()
    for command in (["tar", "-xf", str(file)], ["sha256sum", "--check", "--strict", "MANIFEST"]):
        subprocess.run(command, cwd=tmp_path / "out", check=True, capture_output=True)


def test_one_hand_alone(hands: dict, tmp_path: Path, state_dir: Path) -> None:
    file = backed_up(tmp_path / "backup.tar")
    shutil.rmtree(state_dir)
    restore(file, "left")
    assert hands_with_versions() == ["left"]
    with pytest.raises(BadInput, match="left, right"):
        restore(file, "middle")


def test_a_hand_that_has_other_versions_is_refused_and_merged_when_asked(
    hands: dict[str, list[Version]], tmp_path: Path, state_dir: Path, draft: Make, mjcf: str
) -> None:
    file = backed_up(tmp_path / "backup.tar")
    shutil.rmtree(state_dir)
    store = VersionStore("left")
    mine = store.promote(store.add(draft(0.9, hand="left"), mjcf).id)
    with pytest.raises(BadInput, match="--merge"):
        restore(file)
    assert store.list()[1:] == [mine]
    assert hands_with_versions() == ["left"], "nothing of the other hand was brought back either"
    restore(file, merge=True)
    assert store.list()[1:] == [mine, *hands["left"]]
    assert store.aliases() == {"current": mine.id, "previous": "nominal"}, "names stay as they are"
    assert store.notes()[hands["left"][0].id][0].text.startswith("new tendon")
    assert verify(store).problems == ()


def test_a_pruned_model_comes_back(hands: dict[str, list[Version]], tmp_path: Path, draft: Make, mjcf: str) -> None:
    store = VersionStore("left")
    child = store.add(draft(0.8, hand="left", parent=hands["left"][2].id), mjcf, alias="candidate")
    file = backed_up(tmp_path / "backup.tar")
    prune(store, Policy(keep=0, older_than_days=0.0))
    assert set(verify(store).stubs) == {hands["left"][2].id}
    assert restore(file, "left", merge=True)[0].versions == (hands["left"][2].id,)
    assert store.model(hands["left"][2].id) == mjcf
    assert store.get("candidate") == child
    assert verify(store).problems == ()


def test_a_restore_that_was_cut_off_can_be_finished(
    hands: dict[str, list[Version]], tmp_path: Path, state_dir: Path
) -> None:
    before = state_of("left")
    file = backed_up(tmp_path / "backup.tar")
    shutil.rmtree(VersionStore("left").contents.folders)
    assert restore(file, "left")[0].how == "merged"
    assert state_of("left") == before


def changed_byte(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[data.index(b"FFJ3.damping") + 2] ^= 1
    path.write_bytes(data)


def with_a_stranger(path: Path) -> None:
    with tarfile.open(path, "a") as tar:
        info = tarfile.TarInfo("hands/../../../evil")
        tar.addfile(info)


def with_a_link(kind: bytes, target: str) -> Callable[[Path], None]:
    def harm(path: Path) -> None:
        with tarfile.open(path, "a") as tar:
            info = tarfile.TarInfo("hands/left/versions/0123456789abcdef/model.xml")
            info.type, info.linkname = kind, target
            tar.addfile(info)

    return harm


def with_a_sparse_file(path: Path) -> None:
    """Of a terabyte, which a header of 512 bytes stands for."""
    with tarfile.open(path, "a") as tar:
        info = tarfile.TarInfo("hands/left/versions/0123456789abcdef/model.xml")
        info.pax_headers = {"GNU.sparse.major": "0", "GNU.sparse.minor": "1"}
        info.pax_headers |= {"GNU.sparse.map": f"{2**40},0", "GNU.sparse.size": f"{2**40}"}
        tar.addfile(info)


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        (changed_byte, "not what was backed up"),
        (with_a_stranger, "does not belong"),
        (with_a_link(tarfile.SYMTYPE, "/etc/passwd"), "does not belong"),
        (with_a_link(tarfile.SYMTYPE, "nowhere"), "does not belong"),
        (with_a_link(tarfile.LNKTYPE, "nowhere"), "does not belong"),
        (with_a_link(tarfile.FIFOTYPE, ""), "does not belong"),
        (with_a_sparse_file, "does not belong"),
        (lambda path: path.write_bytes(path.read_bytes()[:30_000]), "."),
        (lambda path: path.write_bytes(b"no tar"), "cannot be read as a backup"),
        (lambda path: path.unlink(), "cannot be read as a backup"),
    ],
)
def test_a_damaged_backup_changes_nothing(
    harm: Callable[[Path], object], said: str, hands: dict, tmp_path: Path, state_dir: Path
) -> None:
    file = backed_up(tmp_path / "backup.tar")
    harm(file)
    shutil.rmtree(state_dir)
    with pytest.raises(BadInput, match=said):
        restore(file)
    assert hands_with_versions() == []


def test_a_backup_is_not_replaced_silently_and_leaves_out_what_is_damaged(
    hands: dict[str, list[Version]], tmp_path: Path, state_dir: Path
) -> None:
    file = backed_up(tmp_path / "backup.tar")
    store = VersionStore("left")
    with pytest.raises(BadInput, match="--replace"):
        back_up([store], file)
    (store.resolve(hands["left"][2].id).folder / "model.xml").unlink()
    made = back_up([store], file, replace=True)
    assert made.hands == {"left": tuple(version.id for version in hands["left"][:2])}
    assert len(made.problems) >= 1
    with pytest.raises(BadInput, match="no versions to back up"):
        back_up([VersionStore("empty")], tmp_path / "empty.tar")
