"""`docs/api.md`, made of the functions and their docstrings: `python -m twin_daemon.api.reference_page docs/api.md`."""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from twin_daemon import api
from twin_daemon.api import results
from twin_daemon.diagnosis import verdict
from twin_daemon.estimation.estimate import Estimate
from twin_daemon.files import write_atomically
from twin_daemon.tables import code_cell

_HEAD = """\
# Python API

This page is made by `python -m twin_daemon.api.reference_page docs/api.md`, from the functions themselves. How to use
them is in [the twin from Python](python.md).

```python
import twin_daemon as td
```

Angles are in rad, times in s, errors mean squares in rad²; a number that nobody knows is `None`, or NaN where a type is
`Number`. `Text` is a string or a path, `Recordings` one recording or several. What cannot be used raises `BadInput` or
`UsageError` of `twin_daemon.errors`: what, where, what is allowed, what to do. Functions and fields follow semantic
versioning with [the JSON](json.md).
"""
_FUNCTIONS = ("hand", "recording", "compare", "check", "calibrate", "diagnose", "add", "ladder", "versions")
_INPUTS = (api.Robot, api.Recording)
_RESULTS = (
    results.Comparison,
    results.Check,
    results.Calibration,
    results.Diagnosis,
    results.Addition,
    results.Ladder,
    results.Versions,
)
_PARTS = (
    results.Mse,
    results.JointError,
    results.Prospect,
    results.Fitted,
    results.Version,
    verdict.Finding,
    Estimate,
    verdict.Trial,
    verdict.Failure,
    verdict.Experiment,
    verdict.Step,
    verdict.ReferenceErrors,
)


def page() -> str:
    """The page as Markdown."""
    parts = [_HEAD, "\n## Functions\n"]
    parts += [_function(f"td.{name}", getattr(api, name)) for name in _FUNCTIONS]
    parts.append("\n## What they take\n")
    parts += [_class(one) for one in _INPUTS]
    parts.append(f"\n## What they return\n\n{_said(results.Result)}\n\n{_methods(_parsed(results.Result))}")
    parts += [_class(one) for one in _RESULTS]
    parts.append("\n## Parts of results\n")
    parts += [_class(one) for one in _PARTS]
    return "".join(parts)


def _function(name: str, function: Callable[..., Any]) -> str:
    return f"\n### `{name}`\n\n```python\n{_call(name, inspect.signature(function))}\n```\n\n{_said(function)}\n"


def _call(name: str, signature: inspect.Signature) -> str:
    """The signature in one line, or an argument a line."""
    arguments = [_argument(one) for one in signature.parameters.values()]
    kinds = [one.kind for one in signature.parameters.values()]
    if inspect.Parameter.KEYWORD_ONLY in kinds:
        arguments.insert(kinds.index(inspect.Parameter.KEYWORD_ONLY), "*")
    line = f"{name}({', '.join(arguments)}) -> {signature.return_annotation}"
    if len(line) <= 100:
        return line
    listed = "".join(f"    {argument},\n" for argument in arguments)
    return f"{name}(\n{listed}) -> {signature.return_annotation}"


def _argument(one: inspect.Parameter) -> str:
    default = "" if one.default is inspect.Parameter.empty else f" = {one.default!r}"
    return f"{one.name}: {one.annotation}{default}"


def _class(one: type) -> str:
    text = f"\n### `{one.__name__}`\n\n{_said(one)}\n"
    fields = [field for above in reversed(_own(one)) for field in _fields(_parsed(above))]
    if fields:
        text += "\n| field | type | meaning |\n|---|---|---|\n"
        text += "".join(f"| `{name}` | {code_cell(kind)} | {said} |\n" for name, kind, said in fields)
    methods = _methods(_parsed(one))
    return text + (f"\n{methods}" if methods else "")


def _own(one: type) -> list[type]:
    """A class and those above it whose fields are its own."""
    return [
        above for above in one.__mro__ if above.__module__.startswith("twin_daemon.") and above is not results.Result
    ]


def _parsed(one: type) -> ast.ClassDef:
    found = ast.parse(inspect.getsource(one)).body[0]
    assert isinstance(found, ast.ClassDef)
    return found


def _fields(one: ast.ClassDef) -> Iterator[tuple[str, str, str]]:
    """(name, type, meaning) of what a class declares; the meaning is the string that follows it, if any."""
    for here, after in zip(one.body, [*one.body[1:], None], strict=True):
        if not isinstance(here, ast.AnnAssign) or not isinstance(here.target, ast.Name):
            continue
        name, said = here.target.id, ""
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            said = " ".join(str(after.value.value).split())
        if not name.startswith("_") and name != "format":
            yield name, ast.unparse(here.annotation), said


def _methods(one: ast.ClassDef) -> str:
    """What can be asked of it beside its fields, where that has a docstring."""
    rows: list[str] = []
    for member in one.body:
        if not isinstance(member, ast.FunctionDef) or member.name.startswith("_"):
            continue
        decorators = {ast.unparse(one) for one in member.decorator_list}
        said = ast.get_docstring(member)
        if said and "classmethod" not in decorators:
            call = f".{member.name}" + ("" if decorators & {"property", "cached_property"} else "()")
            rows.append(f"- `{call}`: {' '.join(said.split())}\n".replace("rad^2", "rad²"))
    return "".join(rows)


def _said(one: Any) -> str:
    return inspect.cleandoc(one.__doc__ or "").replace("rad^2", "rad²")


if __name__ == "__main__":
    write_atomically(Path(sys.argv[1]), page().encode())
