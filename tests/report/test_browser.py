"""The page in a real browser: every chart is drawn, and the console stays silent."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.report.conftest import Page

Made = tuple[Page, dict[str, Any]]

_FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
    "--disable-background-networking", "--host-resolver-rules=MAP * ~NOTFOUND", "--enable-logging=stderr",
    "--virtual-time-budget=20000", "--dump-dom",
)  # fmt: skip


@pytest.fixture(scope="session")
def chromium() -> str:
    for name in ("chromium", "chromium-browser", "google-chrome"):
        if (found := shutil.which(name)) is not None:
            return found
    pytest.skip("no Chromium on this machine (Debian: apt install chromium)")


def opened(chromium: str, page: Path, folder: Path) -> tuple[str, list[str]]:
    """(the page as the browser has it in the end, what its console said)."""
    command = [chromium, *_FLAGS, f"--user-data-dir={folder / 'profile'}", page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    return done.stdout, [line for line in done.stderr.splitlines() if ":CONSOLE" in line]


def test_every_chart_is_drawn_and_the_console_is_silent(chromium: str, plain_report: Made, tmp_path: Path) -> None:
    page, result = plain_report
    drawn, said = opened(chromium, Path(result["path"]), tmp_path)
    assert said == []
    assert 'data-drawn="all"' in drawn
    plots = re.findall(r'<div class="plot js-plotly-plot"', drawn)
    assert len(plots) == len(page.all("figure")) == 8
    assert "rh_FFJ3" in drawn


def test_a_script_that_got_in_all_the_same_would_not_run(chromium: str, plain_report: Made, tmp_path: Path) -> None:
    page, _ = plain_report
    slipped = '<p id="proof">whole</p><script>document.getElementById("proof").textContent = "broken"</script>'
    (tmp_path / "slipped.html").write_text(page.html.replace("<main>", f"<main>{slipped}"), encoding="utf-8")
    drawn, said = opened(chromium, tmp_path / "slipped.html", tmp_path)
    assert '<p id="proof">whole</p>' in drawn
    assert any("Content Security Policy" in line for line in said)
