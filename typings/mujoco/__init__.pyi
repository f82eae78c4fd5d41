# MuJoCo's compiled modules carry no types. Until they do, every name of it is accepted as it is.
from typing import Any

def __getattr__(name: str) -> Any: ...
