"""What is installed is what was locked: pinned, hashed, and wheels alone, so that installing runs nobody's code."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LOCKS = sorted([*ROOT.glob("requirements*.lock"), *(ROOT / "tools").glob("*.lock")])


def requirements(lock: Path) -> list[str]:
    """Each requirement with its options, as one line."""
    text = lock.read_text().replace("\\\n", " ")
    lines = [line.strip() for line in text.splitlines()]
    return [line for line in lines if line and not line.startswith(("#", "--only-binary"))]


@pytest.mark.parametrize("lock", LOCKS, ids=lambda lock: lock.name)
def test_a_lock_pins_everything_with_its_hashes_and_takes_wheels_alone(lock: Path) -> None:
    assert "\n--only-binary :all:\n" in lock.read_text()
    found = requirements(lock)
    assert found
    pinned = r"^[a-z0-9][a-z0-9._-]*==[\w.+!]+( ; [^#]+?)?( +--hash=sha256:[0-9a-f]{64})+$"
    for line in found:
        assert re.match(pinned, line), line[:100]


def test_the_one_package_without_a_wheel_is_left_out_by_name() -> None:
    assert not any(line.startswith("empy") for lock in LOCKS for line in requirements(lock))
    assert "empy" in (ROOT / "tools" / "lock.sh").read_text()


@pytest.mark.parametrize("script", ["lock.sh", "setup.sh"])
def test_nothing_is_installed_without_a_hash(script: str) -> None:
    text = (ROOT / "tools" / script).read_text().replace("\\\n", " ")
    calls = [line for line in text.splitlines() if re.search(r'"\$\{pip\[@\]\}"|pip\b.* install', line)]
    calls = [line for line in calls if not line.lstrip().startswith(("#", "pip=("))]
    assert calls
    for line in calls:
        itself = "--no-deps --no-build-isolation --editable ." in line
        assert itself or "--require-hashes" in line, line
