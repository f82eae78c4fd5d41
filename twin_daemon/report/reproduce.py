"""What it takes to make a page again: commands, programs, seeds, and the bytes that went in."""

from __future__ import annotations

import hashlib
import platform
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from twin_daemon.simulation.alignment import Aligned
from twin_daemon.versions import Version
from twin_daemon.versions.version import program_versions

_PACKAGES = ("scipy", "plotly", "jinja2")


@dataclass(frozen=True)
class Ingredient:
    """One thing that went in: what it was for, its name as given, and the SHA-256 of its bytes."""

    role: str
    name: str
    sha256: str


@dataclass(frozen=True)
class Recipe:
    """Commands as a shell takes them, versions by program, seeds by what they were for, and the ingredients."""

    commands: tuple[str, ...]
    programs: dict[str, str]
    made_by: dict[str, str]
    seeds: dict[str, int]
    ingredients: tuple[Ingredient, ...]


def command_line(words: Iterable[str], options: Mapping[str, object]) -> str:
    """A command as a shell takes it; options without a value are left out, lists follow their option."""
    line = list(words)
    for option, value in options.items():
        if value is None or value == [] or value is False:
            continue
        line.append(option)
        if isinstance(value, (list, tuple)):
            line += [str(item) for item in value]
        elif value is not True:
            line.append(str(value))
    return shlex.join(line)


def sha256_of(path: Path) -> str:
    """Of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def ingredients(version: Version | None, recordings: Mapping[str, Sequence[Aligned]]) -> list[Ingredient]:
    """The recordings by what they were for, and the version with what it was made of."""
    found = [
        Ingredient(role, str(one.recording.path), one.recording.sha256)
        for role, many in recordings.items()
        for one in many
    ]
    if version is not None:
        found.append(Ingredient("version (its id)", version.title or version.kind, version.id))
        if version.mjcf_sha256 is not None:
            found.append(Ingredient("the version's MJCF", "model.xml", version.mjcf_sha256))
        for role, used in (
            ("version fitted on", version.fitted_on),
            ("version tested on", version.held_out_on),
        ):
            found += [Ingredient(role, one.name, one.sha256) for one in used]
    return found


def recipe(
    commands: Sequence[str], version: Version | None, seeds: Mapping[str, int | None], went_in: Sequence[Ingredient]
) -> Recipe:
    """Everything of it, with the versions of the programs that are running now."""
    programs = {**program_versions(), **{name: metadata.version(name) for name in _PACKAGES}}
    return Recipe(
        commands=tuple(commands),
        programs={**programs, "system": f"{platform.system()} {platform.machine()}"},
        made_by=dict(version.program) if version is not None else {},
        seeds={name: seed for name, seed in seeds.items() if seed is not None},
        ingredients=tuple(went_in),
    )


def how_it_was_fitted(version: Version) -> str:
    """One line on what made a version, as a comment of a shell."""
    search = version.search or {}
    said = {"by": search.get("name"), "over": search.get("space"), "budget": search.get("budget"), "seed": version.seed}
    words = ", ".join(f"{name} {value}" for name, value in said.items() if value is not None)
    line = f"# version {version.short_id}: {version.title or version.kind}" + (f" ({words})" if words else "")
    return " ".join(line.split())
