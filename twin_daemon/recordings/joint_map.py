"""Files that say which joint of the model a name in the data means."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import yaml

from twin_daemon.errors import BadInput, nearest
from twin_daemon.yaml_files import load_yaml

_FORM = "lines of the form 'name in the data: name in the model'"


def load_joint_map(path: str | Path) -> dict[str, str]:
    """A YAML file of `data name: model name`. Raises BadInput if it says anything else."""
    path = Path(path)
    try:
        content = load_yaml(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"cannot read the joint map ({error.strerror})", where=path, allowed=_FORM) from None
    except (yaml.YAMLError, UnicodeDecodeError):
        raise BadInput("the joint map is not YAML", where=path, allowed=_FORM) from None
    if not isinstance(content, dict) or not content:
        raise BadInput("the joint map is empty or not a mapping", where=path, allowed=_FORM)
    for name, target in content.items():
        if not (isinstance(name, str) and isinstance(target, str) and name and target):
            raise BadInput(f"the joint map has {name!r}: {target!r}", where=path, allowed=_FORM)
    _require_distinct(list(content.values()), path)
    return content


def check_joint_map(joint_map: Mapping[str, str], joints: Sequence[str], commands: Sequence[str], where: Path) -> None:
    """Refuses a map that means nothing for a recording, or that gives two of its joints the same name."""
    known = [*joints, *(name for name in commands if name not in joints)]
    if joint_map and not any(name in known for name in joint_map):
        name = next(iter(joint_map))
        raise BadInput(
            f"the joint map names no joint of the recording, such as '{name}'", where=where, todo=nearest(name, known)
        )
    for names in (joints, commands):
        _require_distinct([joint_map.get(name, name) for name in names], where)


def _require_distinct(names: list[str], where: Path) -> None:
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise BadInput(f"two names are mapped to '{twice}'", where=where, allowed="each joint of the model once")
