"""Pruning frees space and never takes what somebody may want back."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from twin_daemon.errors import BadInput
from twin_daemon.versions import Draft, Version, VersionStore
from twin_daemon.versions.history import history
from twin_daemon.versions.lineage import tree
from twin_daemon.versions.prune import Policy, plan, prune
from twin_daemon.versions.verify import verify

ALL_OLD = Policy(keep=0, older_than_days=0.0)


class Clock:
    def __init__(self) -> None:
        self.now = datetime(2026, 1, 1, tzinfo=UTC)

    def __call__(self) -> datetime:
        self.now += timedelta(days=1)
        return self.now


@pytest.fixture
def aged(tmp_path: Path) -> VersionStore:
    """A store whose clock moves a day each time it is read."""
    return VersionStore("hand", root=tmp_path / "aged", shipped=tmp_path / "none", now=Clock())


def chain(store: VersionStore, draft: Callable[..., Draft], mjcf: str, count: int) -> list[Version]:
    made: list[Version] = []
    for number in range(count):
        parent = made[-1].id if made else None
        made.append(store.add(draft(0.1 + 0.01 * number, parent=parent), mjcf, alias="candidate"))
    return made


def test_names_stay_whole_ancestors_stay_as_stubs_and_the_rest_goes(
    aged: VersionStore, draft: Callable[..., Draft], mjcf: str
) -> None:
    line = chain(aged, draft, mjcf, 3)
    loose = [aged.add(draft(0.5 + n), mjcf) for n in range(3)]
    aged.set_alias("bench", loose[0].id)
    said = {choice.version: choice.action for choice in plan(aged, ALL_OLD)}
    before = aged.list()
    actions = ["stub", "stub", "keep", "keep", "remove", "remove"]
    assert [said[version.id] for version in (*line, *loose)] == actions
    assert aged.list() == before, "a plan changes nothing"
    freed = sum(choice.frees_bytes for choice in prune(aged, ALL_OLD))
    assert freed > 0
    assert [version.id for version in aged.list()[1:]] == [version.id for version in (*line, loose[0])]
    assert aged.model(line[2].id) == aged.model("bench") == mjcf
    assert aged.get(line[0].id) == line[0], "a stub has its numbers"
    for action in (aged.model, aged.promote, lambda version: aged.set_alias("mine", version)):
        with pytest.raises(BadInput, match="was pruned"):
            action(line[0].id)
    found = verify(aged)
    assert found.problems == ()
    assert set(found.stubs) == {line[0].id, line[1].id}
    assert set(found.pruned) == {loose[1].id, loose[2].id}
    sums = ["sha256sum", "--check", "--strict", "SHA256SUMS"]
    subprocess.run(sums, cwd=aged.resolve(line[0].id).folder, check=True, capture_output=True)
    assert [choice.action for choice in prune(aged, ALL_OLD)] == ["keep"] * 4, "a second time nothing is left to do"


def test_a_stub_becomes_whole_when_the_same_is_stored_again(
    aged: VersionStore, draft: Callable[..., Draft], mjcf: str
) -> None:
    first, _ = chain(aged, draft, mjcf, 2)
    prune(aged, ALL_OLD)
    assert aged.add(draft(0.1), mjcf) == first
    assert aged.model(first.id) == mjcf
    assert verify(aged).problems == ()


def test_ancestors_may_stay_whole(aged: VersionStore, draft: Callable[..., Draft], mjcf: str) -> None:
    chain(aged, draft, mjcf, 3)
    assert {choice.action for choice in plan(aged, Policy(0, 0.0, "whole"))} == {"keep"}


def test_count_and_age_keep_what_is_new(aged: VersionStore, draft: Callable[..., Draft], mjcf: str) -> None:
    made = [aged.add(draft(0.1 * (n + 1)), mjcf) for n in range(6)]
    by_count = {c.version for c in plan(aged, Policy(keep=4, older_than_days=0.0)) if c.action == "remove"}
    assert by_count == {version.id for version in made[:2]}
    age = aged.now() - datetime.fromisoformat(made[3].created)
    young = Policy(keep=0, older_than_days=age / timedelta(days=1))
    assert {c.version for c in plan(aged, young) if c.action == "remove"} <= {version.id for version in made[:4]}
    assert not [c for c in plan(aged, Policy(keep=0, older_than_days=1000.0)) if c.action == "remove"]


def test_one_can_go_back_several_times_and_the_history_stays(
    aged: VersionStore, draft: Callable[..., Draft], mjcf: str
) -> None:
    made = [aged.promote(aged.add(draft(0.1 * (n + 1)), mjcf).id) for n in range(9)]
    prune(aged, ALL_OLD)
    assert verify(aged).problems == ()
    (damping,) = history(aged)
    assert [point.version for point in damping.points] == [version.id for version in made]
    back = [aged.rollback().id for _ in range(4)]
    assert back == [version.id for version in made[7:3:-1]]
    assert [aged.rollback().id for _ in range(2)] == ["nominal"] * 2, "where every way back ends"


def test_a_version_made_from_a_pruned_one_says_so(aged: VersionStore, draft: Callable[..., Draft], mjcf: str) -> None:
    gone = aged.add(draft(0.5), mjcf)
    aged.add(draft(0.6), mjcf, alias="candidate")
    prune(aged, ALL_OLD)
    child = aged.add(draft(0.7, parent=gone.id), mjcf)
    assert verify(aged).problems == ()
    assert [branch.version.id for branch in tree(aged.list())][-1] == child.id


def test_the_lineage_is_a_tree(store: VersionStore, draft: Callable[..., Draft], mjcf: str) -> None:
    root = store.add(draft(0.1), mjcf)
    left, right = (store.add(draft(damping, parent=root.id), mjcf) for damping in (0.2, 0.3))
    leaf = store.add(draft(0.4, parent=left.id), mjcf)
    (nominal,) = tree(store.list())
    assert nominal.version.id == "nominal"
    (branch,) = nominal.children
    assert branch.version == root
    assert [child.version for child in branch.children] == [left, right]
    assert [child.version for child in branch.children[0].children] == [leaf]
