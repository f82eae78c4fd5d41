"""The page's files are those that its sources make: by their fingerprint, and by building them anew where node is."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
from pathlib import Path

import pytest

import twin_daemon.web
from twin_daemon.effects import LIBRARY

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "page"
STATIC = Path(twin_daemon.web.__file__).parent / "static"
DRAWINGS = "../twin_daemon/figures/drawings"
SOURCES = (DRAWINGS, "package-lock.json", "public", "src", "tsconfig.json", "vite.config.ts")


def files(path: Path) -> list[Path]:
    return [one for name in sorted(path.iterdir()) for one in files(name)] if path.is_dir() else [path]


def test_the_page_was_built_after_its_last_change() -> None:
    digest = hashlib.sha256()
    for path in (one for name in SOURCES for one in files(PAGE / name)):
        digest.update(os.path.relpath(path, PAGE).encode() + b"\0" + path.read_bytes() + b"\0")
    assert (STATIC / "built-from.txt").read_text().strip() == digest.hexdigest(), "cd page && npm ci && npm run build"


def test_every_effect_of_the_library_is_drawn() -> None:
    script = (STATIC / "workbench.js").read_text()
    assert [key for key in LIBRARY if f"figures/drawings/{key}.svg" not in script] == []


@pytest.mark.slow
def test_the_page_is_what_its_sources_make(tmp_path: Path) -> None:
    npm = shutil.which("npm")
    if npm is None:
        pytest.skip("no node on this machine: the page's files are not built anew")
    copy = tmp_path / "page"
    shutil.copytree(PAGE, copy, ignore=shutil.ignore_patterns("node_modules"))
    shutil.copytree(PAGE / DRAWINGS, copy / DRAWINGS)
    fetched = subprocess.run(
        [npm, "ci", "--no-audit", "--no-fund"], cwd=copy, capture_output=True, text=True, check=False
    )
    if fetched.returncode != 0 and "network" in fetched.stderr.lower():
        pytest.skip("the package registry cannot be reached: the page's files are not built anew")
    assert fetched.returncode == 0, fetched.stderr
    out = tmp_path / "static"
    subprocess.run([npm, "run", "build"], cwd=copy, env={**os.environ, "TWIN_PAGE_OUT": str(out)}, check=True)
    assert sorted(one.name for one in out.iterdir()) == sorted(one.name for one in STATIC.iterdir())
    differing = [one.name for one in out.iterdir() if one.read_bytes() != (STATIC / one.name).read_bytes()]
    assert differing == []
