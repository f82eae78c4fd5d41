"""The tutorial does what it says: its commands are run as they stand there."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import mujoco
import pytest

from tests.processes.conftest import Twin

_PAGE = Path(__file__).resolve().parents[2] / "docs" / "tutorial.md"
_LONGEST_S = 240.0


@pytest.mark.slow
def test_its_commands_name_what_is_hidden(twin: Twin, tmp_path: Path) -> None:
    blocks = re.findall(r"```sh\n(.*?)```", _PAGE.read_text(encoding="utf-8"), re.DOTALL)
    commands = [shlex.split(line) for block in blocks for line in block.splitlines()]
    assert len(commands) > 8
    for program, *arguments in commands:
        assert program == "twin"
        code, _, err = twin.finish(twin.start(*arguments), _LONGEST_S)
        assert code == 0, (arguments, err)

    read = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in tmp_path.glob("*.json")}
    assert read["tuned"]["holdout_after"]["mse_rad2"] < read["tuned"]["holdout_before"]["mse_rad2"]
    (finding,) = read["diagnosis"]["findings"]
    assert (finding["effect"], finding["joints"]) == ("backlash", ["rh_FFJ3"])
    # the motor of the stand-in hand weighs nothing: its play and a silent servo are one law
    assert read["diagnosis"]["verdict"] in ("ambiguous", "explained")
    assert set(finding["confusable_with"]) <= {"dead_zone:rh_FFJ3"}
    low, high = next(iter(finding["parameters"].values()))["ci95"]
    assert low <= 0.02 <= high
    # the named effect leaves less of what it has not seen than all the parameters together
    assert read["after"]["mse_rad2"] < 0.5 * read["tuned"]["holdout_after"]["mse_rad2"]
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "hand.xml")).nu == 20
