"""A live digital twin of a dexterous hand that knows what it does not model.

`import twin_daemon as td` has what the commands do as functions (docs/python.md). What they need is loaded when the
first of them is asked for. Their types are in `__init__.pyi`.
"""

import importlib
import os

__version__ = "0.1.0"

# Work is shared out among threads of our own. Those of the matrix library, which reads this as it is loaded, would wait
# for them and burn a core meanwhile.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

_API = ("add", "calibrate", "check", "compare", "diagnose", "hand", "ladder", "recording", "versions")


def __getattr__(name):
    if name in _API:
        return getattr(importlib.import_module("twin_daemon.api"), name)
    raise AttributeError(f"module 'twin_daemon' has no attribute '{name}'")


def __dir__():
    return sorted({*globals(), *_API})
