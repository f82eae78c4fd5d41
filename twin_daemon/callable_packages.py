"""Packages whose name is a function of the Python API as well: `td.hand(...)` beside `twin_daemon.hand`.

Python binds a package to its name in the parent as soon as anything imports it, over any function of that name. So the
package itself can be called, and calls the function.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import Any


class _CallablePackage(ModuleType):
    def __call__(self, *args: Any, **options: Any) -> Any:
        function = self.__name__.rpartition(".")[2]
        return getattr(importlib.import_module("twin_daemon.api"), function)(*args, **options)


def make_callable(package: str) -> None:
    """Makes a loaded package call the function of its own name in the Python API."""
    sys.modules[package].__class__ = _CallablePackage
