"""How numbers are drawn: one generator for each aspect of a case, so that a change of one leaves the others alone."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import TypeVar

import numpy as np

T = TypeVar("T")


def dice(seed: int, aspect: str) -> np.random.Generator:
    """The generator of one aspect ("robot", "motion", "noise") of the case `seed`."""
    return np.random.default_rng([seed, zlib.crc32(aspect.encode())])


def log_uniform(random: np.random.Generator, low: float, high: float) -> float:
    """A number between `low` and `high`, each factor of it equally likely."""
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def pick(random: np.random.Generator, options: Sequence[T]) -> T:
    """One of the options, each equally likely."""
    return options[int(random.integers(len(options)))]


def chance(random: np.random.Generator, share: float) -> bool:
    """True in `share` of the cases."""
    return bool(random.random() < share)


def sign(random: np.random.Generator) -> float:
    """-1 or 1."""
    return 1.0 if random.random() < 0.5 else -1.0
