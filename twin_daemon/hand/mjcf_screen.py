"""An MJCF is looked at before MuJoCo reads it: its compiler trusts whatever a file asks for.

Refused are entities, files outside the model's folder, depths that overrun a stack, and sizes that no hand has
and no memory holds. Everything else is MuJoCo's to judge.
"""

from __future__ import annotations

import math
import stat
from pathlib import Path
from xml.parsers import expat

from twin_daemon.errors import BadInput

MAX_BYTES = 20_000_000
MAX_DEPTH = 100
MAX_ELEMENTS = 10_000
"""Of all files together, with every copy and attachment written out: the compiler takes time by their square."""
MAX_CELLS = 100_000_000
"""Of pixels, heights and values of sensors."""
MAX_FACETS = 2000
MAX_EACH = 1000
"""Of what is given to each body, geom and the like, and of keyframes."""
MAX_ITERATIONS = 10_000
MIN_TIMESTEP_S = 1e-5
MAX_FILES = 100
MAX_FILE_BYTES = 200_000_000
MAX_ASSET_BYTES = 200_000_000
"""Of all files that it reads, each as often as it is asked for: MuJoCo makes five times as much of a mesh."""

_FILES = ("file", "fileup", "fileback", "filedown", "filefront", "fileleft", "fileright", "filefwd", "filename")
_FOLDERS = ("meshdir", "texturedir", "assetdir")
_COPIES = {"replicate": ("count",), "composite": ("count",), "flexcomp": ("count", "cellcount")}
_CELLS = ("nrow", "ncol", "width", "height", "gridsize", "resolution", "num", "nsample")
_MEMORY = {"": 1, "K": 2**10, "M": 2**20, "G": 2**30}
MAX_MEMORY = 2 * 2**30
_PNG = b"\x89PNG\r\n\x1a\n"


def screen_mjcf(path: Path) -> None:
    """BadInput for an MJCF, or one that it includes or attaches, that asks for what no model needs."""
    screen = _Screen(path)
    screen.walk(path.resolve(), 1.0)
    for model in screen.models:  # grows while it is walked
        screen.walk(model, max(screen.attached, 1.0))
    screen.look_at_assets()


class _Screen:
    """What the files of one model ask for together."""

    def __init__(self, path: Path) -> None:
        self.models: list[Path] = []
        self.attached = 0.0
        self._path = path
        self._base = path.resolve().parent
        self._folders: set[str] = set()
        self._named: list[tuple[str, Path, float]] = []
        self._files = 0
        self._bytes = 0.0
        self._elements = self._cells = 0.0

    def walk(self, path: Path, copies: float) -> None:
        """Looks at a file of which there will be so many copies, and at what it includes."""
        self._files += 1
        if self._files > MAX_FILES:
            raise BadInput(f"more than {MAX_FILES} files include each other", where=self._path)
        if not _is_file(path):
            what = f"the file that it includes is not there: {path!s:.300}"
            raise BadInput(what, where=self._path, todo="Correct the MJCF")
        self._count_bytes(path.stat().st_size * copies)
        around = [(-1, copies)]  # depth of each element that copies what it holds, and how many that makes
        for depth, tag, attributes in _elements(path):
            while around[-1][0] >= depth:
                around.pop()
            copies = around[-1][1]
            if tag in _COPIES:
                copies *= _product(attributes, _COPIES[tag])
                around.append((depth, copies))
            self._elements += copies
            if self._elements > MAX_ELEMENTS:
                raise _too_many(path)
            self._cells += copies * _cells(tag, attributes, path)
            self._folders.update(value for key in _FOLDERS if (value := attributes.get(key)))
            self.attached += copies if tag == "attach" else 0.0
            for value in (attributes[key] for key in _FILES if attributes.get(key)):
                if tag == "include":
                    self.walk(_inside(self._base, self._base / value, path), copies)
                elif tag == "model":
                    self.models.append(_inside(self._base, self._base / value, path))
                else:
                    self._named.append((value, path, copies))
        self._limit_cells(path)

    def look_at_assets(self) -> None:
        """Meshes, pictures and the like: where they are, and what they unpack to."""
        for value, where, copies in self._named:
            largest = 0
            for start in {self._base, where.parent}:
                for folder in self._folders or {""}:
                    path = _inside(self._base, start / folder / value, where)
                    largest = max(largest, _size(path, where))
                    self._cells += _pixels(path)
                    self._limit_cells(where)
            self._count_bytes(largest * copies)

    def _count_bytes(self, size: float) -> None:
        self._bytes += size
        if self._bytes > MAX_ASSET_BYTES:
            what = f"its files, each as often as it is asked for, have more than {MAX_ASSET_BYTES} bytes"
            raise BadInput(what, where=self._path, todo="Use smaller meshes, or each of them once")

    def _limit_cells(self, where: Path) -> None:
        if self._cells > MAX_CELLS:
            what = f"its grids and pictures have {self._cells:.3g} cells"
            raise BadInput(what, where=where, allowed=f"up to {MAX_CELLS}")


def _too_many(where: Path) -> BadInput:
    return BadInput(
        f"its elements and their copies multiply to more than {MAX_ELEMENTS}", where=where, todo="Write fewer"
    )


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name that no system takes
        return False


def _size(path: Path, where: Path) -> int:
    """Bytes of a file; 0 where there is none. BadInput for what is no file of usual size."""
    try:
        status = path.stat()
    except OSError:
        return 0  # MuJoCo says that it is not there
    if stat.S_ISDIR(status.st_mode):
        return 0
    if not stat.S_ISREG(status.st_mode) or status.st_size > MAX_FILE_BYTES:
        raise BadInput(f"this is no file of up to {MAX_FILE_BYTES} bytes: {path}", where=where)
    return status.st_size


def _pixels(path: Path) -> float:
    """How many pixels a picture has; 0 for what is none."""
    try:
        with path.open("rb") as file:
            start = file.read(24)
    except OSError:
        return 0.0
    if not start.startswith(_PNG):
        return 0.0
    return float(int.from_bytes(start[16:20], "big")) * int.from_bytes(start[20:24], "big")


def _inside(base: Path, path: Path, where: Path) -> Path:
    try:
        resolved = path.resolve()
    except OSError:
        raise BadInput(
            f"no file can be called this: {path.name:.40}...", where=where, todo="Correct the MJCF"
        ) from None
    if not resolved.is_relative_to(base):
        raise BadInput(
            f"it asks for a file outside its folder: {path}",
            where=where,
            allowed=f"files in {base}",
            todo="Copy the file there, or write the path relative to the model",
        )
    return resolved


def _elements(path: Path) -> list[tuple[int, str, dict[str, str]]]:
    """Depth, name and attributes of the elements of a file in order. BadInput for what is no XML, or hostile."""
    if path.stat().st_size > MAX_BYTES:
        raise BadInput(f"{path.stat().st_size} bytes are too many for an MJCF", where=path, allowed=f"to {MAX_BYTES}")
    content = path.read_bytes()
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content or b"\0" in content:
        raise BadInput("it declares a document type or entities", where=path, allowed="plain MJCF in UTF-8")
    found: list[tuple[int, str, dict[str, str]]] = []
    depth = 0

    def begin(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise BadInput(f"it is nested more than {MAX_DEPTH} deep", where=path)
        if len(found) >= MAX_ELEMENTS:
            raise _too_many(path)
        found.append((depth, tag, attributes))

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


def _cells(tag: str, attributes: dict[str, str], where: Path) -> float:
    """How many cells an element has. BadInput for numbers beyond all reason."""
    bounds: dict[str, float] = {}
    if tag == "size":
        bounds = {key: MAX_EACH if key == "nkey" or key.startswith("nuser_") else MAX_CELLS for key in attributes}
        bounds["memory"] = MAX_MEMORY
    elif tag == "option":
        bounds = {key: MAX_ITERATIONS for key in attributes if key.endswith("iterations")}
        if _number(attributes.get("timestep", "1")) < MIN_TIMESTEP_S:
            raise BadInput(f"its timestep is below {MIN_TIMESTEP_S:g} s: no motion would end", where=where)
    for key, most in bounds.items():
        if _memory(attributes.get(key, "")) > most:
            raise BadInput(f"<{tag} {key}='{attributes[key]:.40}'> is beyond reason", where=where, todo="Leave it out")
    if tag == "mesh" and _product(attributes, ("params",)) > MAX_FACETS:
        raise BadInput(f"a made <mesh> of more than {MAX_FACETS} facets is beyond reason", where=where)
    keys = (*_CELLS, "dim") if tag == "user" else _CELLS
    return _product(attributes, keys) if any(key in attributes for key in keys) else 0.0


def _product(attributes: dict[str, str], keys: tuple[str, ...]) -> float:
    """Of all numbers of these attributes, none of them taken for less than 1."""
    return math.prod(max(_number(word), 1.0) for key in keys for word in attributes.get(key, "").split())


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
