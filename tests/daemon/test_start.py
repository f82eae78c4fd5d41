"""What lives as long as the hand starts without what only fits need."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize("module", ["bridges.zenoh.daemon", "bridges.zenoh.gatekeeper"])
def test_it_starts_without_an_optimiser(module: str) -> None:
    """Each process of a hand would begin half a second later."""
    asked = f"import sys, {module}; print([name for name in sys.modules if name.startswith('scipy.optimize')])"
    told = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"
