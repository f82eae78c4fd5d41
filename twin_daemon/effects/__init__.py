"""The library of physical effects, cheapest explanation first."""

from __future__ import annotations

from twin_daemon.effects.base import Effect

LIBRARY: dict[str, Effect] = {}
