"""A first visit to the workbench, counted: from a bag and an empty state folder to a promoted version.

python -m bench.first_visit [--browser chromium] [--way pointer] [--pictures FOLDER] [--no-rules]

Prints clicks, keys, seconds beside the diagnosis itself, what was found, and what axe, the console and the content
security policy said. The seconds are of a visitor who knows where to click: they are the page's and the server's.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from dataclasses import asdict
from pathlib import Path

from tests.processes.conftest import Twin
from tests.web.browser import Browser, chromium
from tests.web.conftest import Workbench
from tests.web.firefox import Firefox, firefox
from tests.web.visit import Found, Visit, loose_finger

WAYS = {"pointer": Visit.by_pointer, "keyboard": Visit.by_keyboard, "phone": Visit.on_a_phone}


def visited(browser: str, way: str, pictures: Path | None, *, rules: bool) -> Found:
    """One visit from an empty state folder."""
    program = {"chromium": chromium, "firefox": firefox}[browser]()
    assert program is not None, f"no {browser} on this machine"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["TWIN_STATE_DIR"] = str(folder / "state")
        bag = loose_finger(folder / "loose_finger.mcap")
        with Twin(folder) as processes, (Browser if browser == "chromium" else Firefox)(program, folder / "b") as shown:
            served = Workbench(processes)
            tab = shown.open("about:blank")

            def picture(moment: str) -> None:
                if pictures is not None:
                    tab.picture(pictures / f"visit-{browser}-{way}-{moment}.png")

            found = WAYS[way](Visit(tab, served.ask, picture, rules=rules), served.page, bag)
            served.end()
    return found


def main() -> None:
    """Prints one figure a line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--browser", choices=("chromium", "firefox"), default="chromium")
    parser.add_argument("--way", choices=tuple(WAYS), default="pointer")
    parser.add_argument("--pictures", type=Path, help="where pictures of the moments go")
    parser.add_argument("--no-rules", action="store_true", help="without axe, which comes with `npm ci` in page/")
    chosen = parser.parse_args()
    if chosen.pictures is not None:
        chosen.pictures.mkdir(parents=True, exist_ok=True)
    found = visited(chosen.browser, chosen.way, chosen.pictures, rules=not chosen.no_rules)
    for name, value in (asdict(found) | {"beside_s": found.beside_s, "load": os.getloadavg()}).items():
        print(f"{name:14} {value}")


if __name__ == "__main__":
    main()
