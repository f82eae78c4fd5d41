"""YAML that nobody here wrote: read with bounds on its size, its depth and what its aliases would become."""

from __future__ import annotations

from typing import Any

import yaml

MAX_BYTES = 4_000_000
"""A description, a trajectory file or a configuration is small; a larger file is something else (or an attack)."""
MAX_VALUES = 1_000_000
"""Of all values with every alias written out: ten lines of aliases can stand for a thousand million."""
MAX_DEPTH = 60


def load_yaml(text: str) -> Any:
    """What a YAML text says. Raises yaml.YAMLError for whatever is wrong with it, and nothing else."""
    if len(text) > MAX_BYTES:
        raise yaml.YAMLError(f"{len(text)} characters are too many, up to {MAX_BYTES} are read")
    try:
        return yaml.load(text, Loader=_Bounded)
    except yaml.YAMLError:
        raise
    except RecursionError:
        raise yaml.YAMLError("it is nested too deeply") from None
    except (ValueError, TypeError, AttributeError, LookupError, ArithmeticError) as error:
        # what the parser's own constructors raise for such as !!timestamp x or 2001-99-99
        raise yaml.YAMLError(f"a value cannot be read: {error}") from None


class _Bounded(yaml.SafeLoader):
    """YAML keeps the last of two equal keys silently; here they are an error. Aliases stay allowed, within bounds."""

    _depth = 0

    def get_single_node(self) -> yaml.Node | None:
        node = super().get_single_node()
        if node is not None:
            _measure(node, {})
        return node

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        self._depth += 1  # looked at on the way in: the scanner takes the square of the depth in time
        if self._depth > MAX_DEPTH:
            raise yaml.YAMLError(f"it is nested more than {MAX_DEPTH} deep")
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[Any] = set()
        for key_node, _ in node.value:
            if key_node.tag == "tag:yaml.org,2002:merge":
                continue
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, str | int | float):
                if key in seen:
                    problem = f"key '{key}' stands there twice"
                    raise yaml.constructor.ConstructorError(None, None, problem, key_node.start_mark)
                seen.add(key)
        return super().construct_mapping(node, deep)


def _measure(node: yaml.Node, known: dict[int, tuple[int, int] | None]) -> tuple[int, int]:
    """How many values a node stands for and how deep they go, aliases written out. None in `known`: under way."""
    if id(node) in known:
        found = known[id(node)]
        if found is None:
            raise yaml.YAMLError("an alias stands for something that contains it")
        return found
    known[id(node)] = None
    inner: list[yaml.Node] = []
    if isinstance(node, yaml.SequenceNode):
        inner = list(node.value)
    elif isinstance(node, yaml.MappingNode):
        inner = [item for pair in node.value for item in pair]
    sizes = [_measure(item, known) for item in inner]
    count, depth = 1 + sum(size[0] for size in sizes), 1 + max((size[1] for size in sizes), default=0)
    if count > MAX_VALUES:
        raise yaml.YAMLError(f"its aliases stand for more than {MAX_VALUES} values")
    if depth > MAX_DEPTH:
        raise yaml.YAMLError(f"its aliases nest more than {MAX_DEPTH} deep")
    known[id(node)] = count, depth
    return count, depth
