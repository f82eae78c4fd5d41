"""A real boot of the installed service in a container; only where root, its tools and a Debian mirror are there."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TOOLS = ("debootstrap", "systemd-nspawn", "nsenter")
LEFT_OUT = 77


@pytest.mark.slow
@pytest.mark.timeout(1500)
@pytest.mark.skipif(os.geteuid() != 0, reason="a container needs root")
@pytest.mark.skipif(any(shutil.which(tool) is None for tool in TOOLS), reason=f"it needs {', '.join(TOOLS)}")
def test_the_service_survives_a_stop_a_kill_and_a_reboot() -> None:
    environment = {**os.environ, "PYTHON": sys.executable, "BOOT_STRICT": "1"}
    script = ["bash", str(ROOT / "tools" / "boot_test.sh")]
    done = subprocess.run(script, env=environment, capture_output=True, text=True)
    if done.returncode == LEFT_OUT:
        pytest.skip(done.stdout.strip())
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    assert done.stdout.rstrip().endswith("boot test passed")
