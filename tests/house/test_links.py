"""No link of the documentation is dead, and the site shows every page. Needs nothing of the extra `docs`."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from twin_daemon.hand.schema import Keys

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "systemd" / "README.md", *sorted(DOCS.rglob("*.md"))]


def prose(page: Path) -> str:
    """The text of a page without its blocks of code."""
    return re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)


def links(page: Path) -> list[str]:
    """What inline links and pictures lead to, but for other servers."""
    text = re.sub(r"`[^`\n]*`", "", prose(page))
    return [link for link in re.findall(r"\]\(([^)\s]+)\)", text) if not re.match(r"[a-z]+:", link)]


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub and Python-Markdown make them alike."""
    found: list[str] = []
    for heading in re.findall(r"^#+ (.+)$", prose(page), flags=re.M):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "")
        found.append(re.sub(r"\s", "-", re.sub(r"[^\w\s-]", "", plain.lower()).strip()))
    return {anchor for anchor in found if found.count(anchor) == 1 and "--" not in anchor}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_of_a_page_leads_somewhere(page: Path) -> None:
    for link in links(page):
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), link
        # The site is made of docs/ alone, and README and units are read beside it.
        assert DOCS in target.parents or DOCS not in page.parents, f"{link} leaves docs/"
        if anchor:
            assert anchor in anchors(target), link


def pages_of(navigation: list[Any]) -> Iterator[str]:
    for entry in navigation:
        for target in entry.values():
            if isinstance(target, str):
                yield target
            else:
                yield from pages_of(target)


def test_the_site_has_every_page_once() -> None:
    configured = tomllib.loads((ROOT / "zensical.toml").read_text(encoding="utf-8"))["project"]
    shown = sorted(pages_of(configured["nav"]))
    assert shown == sorted(path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md"))


def test_the_page_of_the_keys_has_each_of_them() -> None:
    text = (DOCS / "keys.md").read_text(encoding="utf-8")
    for name, field in Keys.model_fields.items():
        assert f"| `{name}` | `{field.default.replace('{ns}', '<ns>').split('{')[0]}" in text, name
