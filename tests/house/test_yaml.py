"""YAML of strangers is read within bounds, and whatever is wrong with it is one kind of error."""

from __future__ import annotations

import pytest
import yaml

from twin_daemon.yaml_files import load_yaml


@pytest.mark.parametrize(
    "text",
    [
        "[" * 100_000,
        "{a: " * 100_000,
        "- " * 100_000,
        "&a [*a]",
        "a: 2001-99-99",
        "a: !!timestamp x",
        "a: !!int x",
        "a: !!python/object/apply:os.system [ls]",
        "a: 1\na: 2",
        "{[]: 1}",
        "\n".join(["a0: &a0 [x]", *(f"a{n}: &a{n} [*a{n - 1}]" for n in range(1, 90))]),
        "9" * 5000,
    ],
)
def test_what_is_hostile_or_broken_is_an_error_of_yaml(text: str) -> None:
    with pytest.raises(yaml.YAMLError):
        load_yaml(text)


def test_aliases_and_merges_are_read() -> None:
    assert load_yaml("a: &a {x: 1}\nb: {<<: *a, y: 2}\nc: *a") == {"a": {"x": 1}, "b": {"x": 1, "y": 2}, "c": {"x": 1}}
