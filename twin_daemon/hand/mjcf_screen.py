"""An MJCF is looked at before MuJoCo reads it: its compiler trusts whatever a file asks for.

Refused are entities, files outside the model's folder, depths that overrun a stack, and sizes that no hand has
and no memory holds. Everything else is MuJoCo's to judge.
"""

from __future__ import annotations

import math
from pathlib import Path
from xml.parsers import expat

from twin_daemon.errors import BadInput

MAX_BYTES = 20_000_000
MAX_DEPTH = 100
MAX_COPIES = 10_000
"""Of all that is repeated: bodies of a composite, copies of a replicate, cells of a grid are counted as products."""
MAX_CELLS = 20_000_000
MAX_INCLUDES = 100

_FILES = ("file", "fileup", "fileback", "filedown", "filefront", "fileleft", "fileright", "filefwd")
_FOLDERS = ("meshdir", "texturedir", "assetdir")
_COUNTS = ("count", "nrow", "ncol", "width", "height", "builtinwidth", "gridsize")
_MEMORY = {"": 1, "K": 2**10, "M": 2**20, "G": 2**30}
MAX_MEMORY = 2 * 2**30


def screen_mjcf(path: Path) -> None:
    """BadInput for an MJCF, or one that it includes, that asks for what no model needs."""
    base = path.resolve().parent
    waiting, seen = [path.resolve()], set[Path]()
    folders: set[str] = set()
    named: list[tuple[str, Path]] = []
    while waiting:
        current = waiting.pop()
        if current in seen:
            continue
        seen.add(current)
        if len(seen) > MAX_INCLUDES:
            raise BadInput(f"more than {MAX_INCLUDES} files include each other", where=path)
        if not current.is_file():
            raise BadInput(f"the file that it includes is not there: {current}", where=path, todo="Correct the MJCF")
        copies = 1
        for tag, attributes in _elements(current):
            folders.update(value for key in _FOLDERS if (value := attributes.get(key)))
            for key in _FILES:
                value = attributes.get(key)
                if value and tag == "include":
                    waiting.append(_inside(base, base / value, current))
                elif value:
                    named.append((value, current))
            copies *= _sizes(tag, attributes, current)
            if copies > MAX_COPIES:
                raise BadInput(f"its copies multiply to more than {MAX_COPIES}", where=current, todo="Write fewer")
    for value, current in named:
        for folder in folders or {""}:
            _inside(base, base / folder / value, current)


def _inside(base: Path, path: Path, where: Path) -> Path:
    resolved = path.resolve()
    if not resolved.is_relative_to(base):
        raise BadInput(
            f"it asks for a file outside its folder: {path}",
            where=where,
            allowed=f"files in {base}",
            todo="Copy the file there, or write the path relative to the model",
        )
    return resolved


def _elements(path: Path) -> list[tuple[str, dict[str, str]]]:
    """Name and attributes of the elements of a file in order. BadInput for what is no XML, or hostile."""
    if path.stat().st_size > MAX_BYTES:
        raise BadInput(f"{path.stat().st_size} bytes are too many for an MJCF", where=path, allowed=f"to {MAX_BYTES}")
    content = path.read_bytes()
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content or b"\0" in content:
        raise BadInput("it declares a document type or entities", where=path, allowed="plain MJCF in UTF-8")
    found: list[tuple[str, dict[str, str]]] = []
    depth = 0

    def begin(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise BadInput(f"it is nested more than {MAX_DEPTH} deep", where=path)
        found.append((tag, attributes))

    def end(_tag: str) -> None:
        nonlocal depth
        depth -= 1

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, LookupError, ValueError) as error:
        what = f"MuJoCo cannot compile this model: no well-formed XML ({error})"
        raise BadInput(what, where=path, todo="Correct the MJCF") from None
    return found


def _sizes(tag: str, attributes: dict[str, str], where: Path) -> int:
    """How many times an element makes what it holds. BadInput for sizes beyond all reason."""
    cells = 1.0
    for key in _COUNTS:
        for word in attributes.get(key, "").split():
            cells *= max(_number(word), 1.0)
    if cells > MAX_CELLS:
        raise BadInput(f"<{tag}> is of {cells:.3g} cells", where=where, allowed=f"up to {MAX_CELLS}")
    if tag == "size":
        for key, value in attributes.items():
            if _memory(value) > (MAX_MEMORY if key == "memory" else MAX_CELLS):
                raise BadInput(f"<size {key}='{value:.40}'> is beyond reason", where=where, todo="Leave it out")
    return int(cells) if tag in ("replicate", "composite", "flexcomp") else 1


def _memory(text: str) -> float:
    text = text.strip()
    unit = text[-1:].upper() if text[-1:].isalpha() else ""
    return _number(text[: len(text) - len(unit)]) * _MEMORY.get(unit, math.inf)


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        return 0.0  # MuJoCo says what is wrong with it
    return value if math.isfinite(value) else math.inf
