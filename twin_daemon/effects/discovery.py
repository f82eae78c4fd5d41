"""Where effects come from: the files of this folder, a user's packages, and a folder that the user names.

A package offers its effects by the entry point group `twin_daemon.effects`, each entry an Effect class. The folder is
named by TWIN_EFFECTS; each of its files may hold one or more classes. What stands there is run as code, so it must
not be a place that the network or another user can write to. Effects that are files of numbers (see `from_files`) stand
in the state folder; nothing of them is run.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import os
import pkgutil
import stat
import sys
from collections.abc import Collection, Iterator
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType

from twin_daemon.effects.base import Effect
from twin_daemon.effects.from_files import effect_of, folder, load_effect_file
from twin_daemon.effects.from_files.schema import SUFFIX
from twin_daemon.errors import BadInput
from twin_daemon.resources import state_dir

GROUP = "twin_daemon.effects"
VARIABLE = "TWIN_EFFECTS"


def built_in() -> list[Effect]:
    """An instance of each effect in this folder, by rank."""
    package = importlib.import_module("twin_daemon.effects")
    names = (f"{package.__name__}.{found.name}" for found in pkgutil.iter_modules(package.__path__))
    effects = [effect for name in names for effect in _of_module(importlib.import_module(name))]
    return sorted(effects, key=lambda effect: effect.rank)


def user_effects(taken: Collection[str]) -> list[Effect]:
    """A user's own effects. Raises BadInput where one cannot be used, or takes a key that is `taken`."""
    found = [*_of_packages(), *_of_folder()]
    known: dict[str, str] = dict.fromkeys(taken, "the library")
    for effect, where in found:
        _require_whole(effect, where)
        if effect.key in known:
            raise BadInput(f"the key '{effect.key}' is that of an effect of {known[effect.key]}", where=where,
                           todo="Give it another key")  # fmt: skip
        known[effect.key] = where
    return [effect for effect, _ in found]


_MOST_FILES = 200


def from_files(taken: Collection[str]) -> tuple[dict[str, Effect], dict[str, str]]:
    """(effects that are files of the state folder by key, what is wrong with the others in a line each).

    One file that is broken takes nothing away from the others, nor from the library.
    """
    usable: dict[str, Effect] = {}
    broken: dict[str, str] = {}
    try:
        paths = sorted(folder().glob(f"*{SUFFIX}"))[:_MOST_FILES]
    except OSError:
        return usable, broken
    for path in paths:
        key = path.name.removesuffix(SUFFIX)
        try:
            if key in taken:
                raise BadInput(f"the key '{key}' is that of an effect of the library", where=path, todo="Rename it")
            usable[key] = effect_of(load_effect_file(path))
        except BadInput as error:
            broken[key] = error.line()
    return usable, broken


def _of_module(module: ModuleType) -> Iterator[Effect]:
    """Instances of the effects that a module itself defines."""
    for _, one in inspect.getmembers(module, inspect.isclass):
        if one.__module__ == module.__name__ and issubclass(one, Effect) and not inspect.isabstract(one):
            yield one()


def _of_packages() -> Iterator[tuple[Effect, str]]:
    for entry in entry_points(group=GROUP):
        where = f"entry point {entry.name} of {entry.dist.name if entry.dist else 'a package'}"
        try:
            one = entry.load()
        except Exception as error:
            raise BadInput(
                f"cannot be loaded: {_told(error)}", where=where, todo="Mend or remove the package"
            ) from None
        if not (inspect.isclass(one) and issubclass(one, Effect) and not inspect.isabstract(one)):
            raise BadInput("is no effect", where=where, allowed="a class of twin_daemon.effects.base.Effect")
        yield one(), where


def _of_folder() -> Iterator[tuple[Effect, str]]:
    given = os.environ.get(VARIABLE)
    if not given:
        return
    folder = Path(given).expanduser().resolve()
    if not folder.is_dir():
        raise BadInput("is no folder", where=f"{VARIABLE}={given}", todo="Make it, or take the variable away")
    files = sorted(path for path in folder.glob("*.py") if not path.name.startswith("_"))
    for path in (folder, *files):
        _require_own(path)
    for path in files:
        try:
            effects = list(_of_module(_loaded(path)))
        except Exception as error:
            raise BadInput(f"cannot be loaded: {_told(error)}", where=path, todo="Mend it, or move it away") from None
        if not effects:
            raise BadInput("holds no effect", where=path, todo="Write a class of Effect, or begin its name with _")
        yield from ((effect, str(path)) for effect in effects)


def _loaded(path: Path) -> ModuleType:
    name = f"twin_daemon_user_effects.{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None  # it is a file of Python
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _require_own(path: Path) -> None:
    """Raises BadInput for what others than its owner can write, and for what the network's writers reach."""
    status = path.resolve().stat()
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH) or status.st_uid not in (0, os.geteuid()):
        raise BadInput(
            "others can write to it, and what stands in it is run", where=path,
            allowed="a place that you or root own, and nobody else can write to", todo=f"chmod go-w {path}",
        )  # fmt: skip
    state = state_dir().resolve()
    if path.resolve().is_relative_to(state) or state.is_relative_to(path.resolve()):
        raise BadInput(
            "lies where the daemon keeps what comes over the network, and what stands in it is run", where=path,
            allowed="a folder outside of the state folder",
        )  # fmt: skip


def _require_whole(effect: Effect, where: str) -> None:
    """Raises BadInput where a class leaves out what every effect declares."""
    name, page = type(effect).__name__, "See docs/add-an-effect.md"
    missing = [part for part in ("key", "title", "acts_on", "parameters", "story") if not hasattr(effect, part)]
    if missing:
        raise BadInput(f"{name} has no {', '.join(missing)}", where=where, todo=page)
    if not effect.parameters:
        raise BadInput(f"{name} has no parameter to fit", where=where, todo=page)


def _told(error: Exception) -> str:
    return f"{type(error).__name__}: {error}".splitlines()[0]
