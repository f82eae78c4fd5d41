"""`twin report`: one page that says all, asks nobody, and runs nothing that came with the data."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shlex
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.report.conftest import Page, report, written
from tests.simulation.made import recorded, saved
from twin_daemon.cli.app import main
from twin_daemon.diagnosis.verdict import Diagnosis, Finding, VerdictName
from twin_daemon.report.page import diagnosis_section
from twin_daemon.report.words import how_sure
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import Draft, ParameterRecord, VersionStore

MOST_BYTES = 6_000_000
EVERYTHING = ["summary", "comparison", "motion", "conditions", "diagnosis", "proposals", "ladder", "parameters",
              "reproduce"]  # fmt: skip


def asks_nobody(page: Page) -> None:
    """No element loads anything, and the policy would not let it."""
    loading = {"src", "srcset", "data", "poster", "background", "action", "formaction", "ping"}
    for tag, attributes in page.elements:
        assert not loading & attributes.keys(), (tag, attributes)
        assert (attributes.get("href") or "#").startswith("#"), (tag, attributes)
        assert not [name for name in attributes if name.startswith("on")], (tag, attributes)
    assert not {"link", "iframe", "img", "object", "embed", "base", "form"} & {tag for tag, _ in page.elements}
    assert "@import" not in page.html.partition("</style>")[0]
    assert "url(" not in page.html.partition("</style>")[0]
    (policy,) = [a["content"] or "" for a in page.all("meta") if a.get("http-equiv") == "Content-Security-Policy"]
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["default-src"] == "'none'"
    assert rules["base-uri"] == rules["form-action"] == "'none'"
    hashes = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in page.run]
    assert rules["script-src"].split() == [f"'sha256-{one}'" for one in hashes]
    assert set(rules) == {"default-src", "script-src", "style-src", "img-src", "base-uri", "form-action"}
    assert rules["img-src"] == "data: blob:"


def test_everything_is_on_one_page(
    bag: Path, diagnosis: dict[str, Any], proposals: dict[str, Any], ladder: dict[str, Any], tmp_path: Path
) -> None:
    page, result = report(
        tmp_path, "--recording", str(bag), "--holdout", str(bag),
        "--diagnosis", written(tmp_path / "d.json", diagnosis), "--ladder", written(tmp_path / "l.json", ladder),
        "--proposals", written(tmp_path / "p.json", proposals),
    )  # fmt: skip
    asks_nobody(page)
    assert page.sections == result["sections"] == EVERYTHING
    content = Path(result["path"]).read_bytes()
    assert result["bytes"] == len(content) < MOST_BYTES
    assert result["sha256"] == hashlib.sha256(content).hexdigest()
    assert sum("plotly.js v" in script for script in page.run) == 1
    for attributes in page.all("a"):
        assert (attributes["href"] or "").removeprefix("#") in {a.get("id") for _, a in page.elements}
    assert "fall" in {a.get("id") for a in page.all("figure")}, "the waterfall of the ladder"
    assert [a.get("data-effect") for a in page.all("svg")] == ["viscous_friction"]
    assert "viscous_friction:rh_FFJ3 predicts" in "".join(page.scripts), "beside what the error depends on"
    for said in (
        "Ambiguous: more than one effect", "Not sure which", "command_delay:rh_FFJ3", "0.55 to 0.65",
        "97% to 99%", "explains less: 4309 nats", "by 20 mrad rms", "a note on the diagnosis",
        "nothing is left", "backlash:rh_FFJ1", "not tested", "None: this is the nominal model",
        "a proposal, not a cause", "0.1 sin(9 q + 0.7)", "Nearest in the library: spring:rh_FFJ3",
        "diagnosis 7", "ladder 3", "Held out motion: finger",
    ):  # fmt: skip
        assert said in page.words, said


def test_the_numbers_are_those_of_compare(bag: Path, plain_report: tuple[Page, dict[str, Any]], tmp_path: Path) -> None:
    page, result = plain_report
    assert main(["compare", "--recording", str(bag), "--json", str(tmp_path / "compare.json")]) == 0
    compared = json.loads((tmp_path / "compare.json").read_text())
    assert result["mse_rad2"] == compared["mse_rad2"]
    assert result["holdout_mse_rad2"] is None
    assert page.sections == ["summary", "comparison", "motion", "conditions", "parameters", "reproduce"]
    for value in (compared["mse_rad2"] ** 0.5, compared["noise_floor_rad2"] ** 0.5,
                  compared["references"]["raw_command"]["mse_rad2"] ** 0.5, compared["joints"]["rh_FFJ3"]["rmse_rad"],
                  compared["groups"]["FJ3"]["mse_rad2"] ** 0.5):  # fmt: skip
        assert f"{1e3 * value:.3g}" in page.words
    overlays = [a.get("data-joint") for a in page.all("figure") if a.get("data-kind") == "overlay"]
    assert set(overlays) == {"rh_FFJ1", "rh_FFJ2", "rh_FFJ3"}
    assert overlays[0] == max(compared["joints"], key=lambda name: compared["joints"][name]["mse_rad2"])


def test_the_commands_on_the_page_make_it_again(
    bag: Path, plain_report: tuple[Page, dict[str, Any]], tmp_path: Path
) -> None:
    page, first = plain_report
    line = next(line for line in page.words.splitlines() if line.startswith("twin report"))
    assert main([*shlex.split(line)[1:], "--json", str(tmp_path / "again.json")]) == 0
    again = json.loads((tmp_path / "again.json").read_text())
    assert (again["path"], again["mse_rad2"]) == (first["path"], first["mse_rad2"])
    assert hashlib.sha256(bag.read_bytes()).hexdigest() in page.words


def test_a_versions_parameters_have_unit_interval_and_bounds(bag: Path, tmp_path: Path, twin: TwinModel) -> None:
    store = VersionStore("shadow_hand")
    changed = twin.changed(twin.terms.with_parameters({"rh_FFJ3.damping": 0.8, "rh_FFJ3.kp": 9.0}))
    fitted = ParameterRecord(
        value=0.8, unit="N m s/rad", lower=0.01, upper=0.8, at_bound=True, ci95=(0.7, 0.9), identifiable="weak"
    )
    draft = Draft(
        hand="shadow_hand",
        kind="calibrated",
        terms=changed.terms.as_json(),
        title="by <b>hand</b>",
        parameters={"rh_FFJ3.damping": fitted},
        search={"name": "least-squares", "space": "physical"},
        seed=11,
    )
    version = store.add(draft, changed.mjcf(), alias="candidate")
    store.promote(version.id)
    page, result = report(tmp_path, "--recording", str(bag))
    assert result["version"] == version.id
    row = re.search(r'<tr class="marked"><th scope="row">rh_FFJ3\.damping</th>(.*?)</tr>', page.html)
    assert row is not None
    cells = re.findall(r"<td[^>]*>(.*?)</td>", row[1])
    assert cells == ["0.8", "N m s/rad", "0.7 to 0.9", "0.01 to 0.8", "yes", "weak", "0.2"]
    assert "rh_FFJ3.kp" in page.words  # set, though not fitted
    assert "# version " + version.short_id + ": by <b>hand</b> (by least-squares, over physical, seed 11)" in page.words
    assert version.id in page.words
    assert version.mjcf_sha256 in page.words
    assert len(page.all("b")) == 4  # those of the summary, none of the title


def test_what_has_changed_over_the_weeks_is_on_the_page(bag: Path, tmp_path: Path, twin: TwinModel) -> None:
    begun, day = datetime(2026, 1, 1, tzinfo=UTC), [0.0]
    store = VersionStore("shadow_hand", now=lambda: begun + timedelta(days=day[0]))
    for week in range(6):
        day[0], damping = 7.0 * week, 0.2 + 0.05 * week
        changed = twin.changed(twin.terms.with_parameters({"rh_FFJ3.damping": damping}))
        fitted = ParameterRecord(value=damping, unit="N m s/rad", ci95=(damping - 0.01, damping + 0.01))
        draft = Draft(
            hand="shadow_hand",
            kind="calibrated",
            terms=changed.terms.as_json(),
            parameters={"rh_FFJ3.damping": fitted},
        )
        store.promote(store.add(draft, changed.mjcf()).id)
    page, result = report(tmp_path, "--recording", str(bag))
    assert "history" in result["sections"]
    assert re.search(r"rh_FFJ3\.damping: \+0\.05 \[", page.words)


EVIL = "<script>alert(1)</script>"
EVIL_MODEL = """<mujoco><worldbody><body>
<joint name="{0}" axis="0 1 0" damping="0.1" armature="0.01"/><geom size="0.05" pos="0.1 0 0"/>
</body></worldbody><actuator><position name="{0}" joint="{0}" kp="5"/></actuator></mujoco>"""


def test_names_from_recordings_and_results_are_shown_and_never_run(
    twin: TwinModel, diagnosis: dict[str, Any], ladder: dict[str, Any], tmp_path: Path
) -> None:
    from twin_daemon.hand import load_hand

    model = tmp_path / "evil.xml"
    model.write_text(EVIL_MODEL.format("&lt;script&gt;alert(1)&lt;/script&gt;"))
    plant = TwinModel.load(load_hand(None, model))
    motion = {EVIL: ([0.0, 1.0, 2.0, 4.0], [0.0, 0.8, 0.8, 0.0])}
    recording = recorded(plant, motion, np.random.default_rng(0), seconds=4.0)
    bag = saved(recording, tmp_path / "<img src=x onerror=alert(1)>.mcap")
    for told in (diagnosis, ladder):
        told["hand"], told["reason"] = "evil", f"because {EVIL}"
    diagnosis["findings"][0] |= {"target": EVIL, "explanation": '"><img src="http://nowhere/">'}
    diagnosis["tried"][0]["lost_because"] = EVIL
    ladder["steps"][1] |= {"target": EVIL, "parameters": {EVIL: 1.0}}
    page, _ = report(
        tmp_path, "--recording", str(bag), "--model", str(model),
        "--diagnosis", written(tmp_path / "d.json", diagnosis), "--ladder", written(tmp_path / "l.json", ladder),
    )  # fmt: skip
    asks_nobody(page)
    assert len(page.run) == 2
    assert EVIL in page.words
    assert "<img src=x onerror=alert(1)>" in page.words
    charts = [json.loads(text) for text in page.scripts if text not in page.run]
    assert EVIL in next(chart for chart in charts if isinstance(chart, list))  # the rows of the heat map, as names
    drawn = json.dumps([chart for chart in charts if not isinstance(chart, list)])
    assert EVIL not in drawn  # where Plotly would read tags
    assert "&lt;script&gt;" in drawn


def test_a_hand_at_rest_has_a_page_that_says_so(twin: TwinModel, tmp_path: Path) -> None:
    motion = {"rh_FFJ3": ([0.0, 2.0], [0.3, 0.3])}
    bag = saved(recorded(twin, motion, np.random.default_rng(0), seconds=2.0), tmp_path / "still.mcap")
    page, result = report(tmp_path, "--recording", str(bag))
    assert page.sections == ["summary", "comparison", "parameters", "reproduce"]
    assert "there is nothing to compare" in page.words
    assert result["mse_rad2"] is None


def test_a_diagnosis_can_be_made_at_once(twin: TwinModel, tmp_path: Path) -> None:
    motion = {"rh_FFJ3": ([0.0, 1.0, 2.0], [0.1, 0.6, 0.1])}
    bag = saved(recorded(twin, motion, np.random.default_rng(0), seconds=2.0), tmp_path / "short.mcap")
    page, result = report(tmp_path, "--recording", str(bag), "--diagnose", "--seed", "5")
    assert "over the joint that moves (23 are still)" in page.words
    assert "diagnosis" in result["sections"]
    assert "Not excited" in page.words
    assert "shorter than 3 s" in page.words
    assert "twin diagnose --version nominal" in page.words
    assert "diagnosis 5" in page.words


@pytest.mark.parametrize(
    ("verdict", "rivals", "gain", "said"),
    [
        ("explained", [], [0.9, 0.99], "Sure, as far as these data go"),
        ("explained", [], [-0.1, 0.4], "Weak: the gain on validation data, or the evidence"),
        ("ambiguous", ["backlash:rh_FFJ3"], [0.9, 0.99], "Not sure which: these data do not tell it from backlash"),
        ("unexplained", [], [0.9, 0.99], "do not take it for the whole cause"),
    ],
)
def test_how_sure_a_finding_is_hangs_on_what_it_rests_on(
    verdict: VerdictName, rivals: list[str], gain: list[float], said: str, diagnosis: dict[str, Any]
) -> None:
    (finding,) = diagnosis["findings"]
    read = Finding.model_validate({**finding, "confusable_with": rivals, "holdout_gain_ci95": gain})
    words = how_sure(read, verdict)
    assert said in words.partition(".")[0]
    assert "Its probability is 97 in 100. Its evidence" in how_sure(
        read.model_copy(update={"probability": 0.97}), verdict
    )


@pytest.mark.parametrize("interrupted", [False, True])
def test_a_search_that_was_ended_early_is_not_said_to_have_found_no_cause(interrupted: bool) -> None:
    found = Diagnosis.without_findings("unexplained", "rh_FFJ3: above the floor")
    said = diagnosis_section(found.model_copy(update={"interrupted": interrupted}))
    assert ("ended before it was through" in said) == interrupted
    assert ("no effect of the library accounts for" in said) != interrupted


def test_what_was_made_for_another_model_is_said(bag: Path, diagnosis: dict[str, Any], tmp_path: Path) -> None:
    diagnosis["version"] = "ab" * 32
    page, result = report(tmp_path, "--recording", str(bag), "--diagnosis", written(tmp_path / "d.json", diagnosis))
    (note,) = result["notes"]
    assert "made for abababababab" in note
    assert note in page.words


@pytest.mark.parametrize(
    ("argv", "code", "says"),
    [
        (["--diagnosis", "none.json"], 3, "none.json"),
        (["--diagnosis", "ladder.json"], 3, "not what twin diagnose writes"),
        (["--ladder", "broken.json"], 3, "not what twin ladder writes"),
        (["--diagnosis", "foreign.json"], 3, "of the hand 'other'"),
        (["--diagnosis", "foreign.json", "--diagnose"], 2, "exclude each other"),
        (["-o", "none/report.html"], 3, "folder does not exist"),
        (["--holdout", "none.mcap"], 3, "none.mcap"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_one_line_and_no_page(
    argv: list[str], code: int, says: str, bag: Path, diagnosis: dict[str, Any], ladder: dict[str, Any],
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    written(tmp_path / "ladder.json", ladder)
    written(tmp_path / "foreign.json", {**diagnosis, "hand": "other"})
    (tmp_path / "broken.json").write_text("{")
    assert main(["report", "--recording", str(bag), *argv]) == code
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1
    assert says in captured.err
    assert not list(tmp_path.rglob("*.html"))


def test_the_page_of_the_real_hand_is_small_enough_to_send(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "shadow_hand_real"
    if not (folder / "hand_closing.csv").is_file():
        pytest.skip("shadow_hand_real/hand_closing.csv is not on this machine")
    page, result = report(
        tmp_path, "--recording", str(folder / "hand_closing.csv"),
        "--trajectory", f"{folder / 'trajectories.yaml'}:hand_closing", "--version", "real_closing",
    )  # fmt: skip
    asks_nobody(page)
    assert result["bytes"] < MOST_BYTES
    assert result["mse_rad2"] < 1e-4
    assert "their onset is estimated" in page.words
    assert "coupling:rh_FFJ0.preload" in page.words
    assert len([a for a in page.all("figure") if a.get("data-kind") == "overlay"]) == 12
