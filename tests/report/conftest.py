"""Small recordings, finished results, and pages read back as a browser would read them."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from tests.diagnosis.findings import finding
from tests.simulation.made import worn_finger
from twin_daemon.cli.app import main
from twin_daemon.diagnosis.verdict import Diagnosis, Experiment, MovedParameter, PartSummary, Trial
from twin_daemon.estimation.estimate import Estimate
from twin_daemon.hand import load_hand
from twin_daemon.jsonable import plain
from twin_daemon.proposals.proposal import Curve, Native, Nearest, Proposal, Proposals, Rival, Value
from twin_daemon.simulation.twin import TwinModel


@pytest.fixture(scope="session")
def twin() -> TwinModel:
    return TwinModel.load(load_hand())


@pytest.fixture(scope="session")
def bag(twin: TwinModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return worn_finger(twin, tmp_path_factory.mktemp("bags") / "finger.mcap")


@pytest.fixture
def diagnosis() -> dict[str, Any]:
    """An ambiguous diagnosis as `twin diagnose` writes it."""
    damping = Estimate(value=0.6, unit="N m s/rad", ci95=(0.55, 0.65))
    found = finding("viscous_friction", "rh_FFJ3", ("rh_FFJ3",), "command_delay:rh_FFJ3", damping=damping)
    trial = Trial(
        effect="backlash", target="rh_FFJ3", evidence_nats=12.0, fit_mse_rad2=9e-4, holdout_mse_rad2=None,
        lost_because="explains less: 4309 nats behind viscous_friction:rh_FFJ3",
    )  # fmt: skip
    experiment = Experiment(
        path="viscous_friction_or_command_delay.yaml",
        trajectory="viscous_friction_or_command_delay.yaml:steps",
        expected_difference_rad=0.02,
        separates=("viscous_friction:rh_FFJ3", "command_delay:rh_FFJ3"),
        why="steps on rh_FFJ3: there the predictions differ by 20 mrad rms",
    )
    part = PartSummary(joints=("rh_FFJ3",), times_floor=120.0, left_times_floor=0.8, within_floor=False)
    whole = Diagnosis(
        verdict="ambiguous",
        reason="viscous_friction at rh_FFJ3 cannot be told from command_delay:rh_FFJ3",
        findings=(found,),
        tried=(trial,),
        where=(),
        parts={"FF": part},
        moved_parameters=(MovedParameter(parameter="rh_FFJ3.kp", sigma=4.5),),
        next_experiment=experiment,
        notes=("a note on the diagnosis",),
        hand="shadow_hand",
        seed=7,
    )
    return plain({"schema": 1, **whole.model_dump(by_alias=True)})


@pytest.fixture
def proposals() -> dict[str, Any]:
    """A law as `twin propose` writes it."""
    curve = Curve(
        at=(-0.2, 0.0, 1.0, 1.2), at_unit="rad", value=(0.1, 0.1, -0.1, -0.1), lower=(0.0, 0.05, -0.15, -0.2),
        upper=(0.2, 0.15, -0.05, 0.0), unit="N m", visited=(0.0, 1.0),
    )  # fmt: skip
    law = Proposal(
        name="proposed_torque_position_0", port="torque", variables=("position",), joints=("rh_FFJ3",),
        formula="0.1 sin(9 q + 0.7)", parameters={"amplitude": Value(value=0.1, ci95=(0.09, 0.11))}, curve=curve,
        holdout_mse_before=4e-5, holdout_mse_after=1e-6, holdout_gain=0.975, holdout_gain_ci95=(0.95, 0.99),
        probability=0.9, null_probability=0.025, evidence=120.0,
        nearest=(Nearest(effect="spring:rh_FFJ3", fails_because="explains less"),),
        native=Native(exact=True, cost="", holdout_gain=0.97), experiment="slow sweeps both ways", file="law.yaml",
    )  # fmt: skip
    rival = Rival(joint="rh_FFJ3", port="reading", variables=("time",), linear_gain=0.1, holdout_gain=None,
                  lost_because="other laws promise more")  # fmt: skip
    found = Proposals(verdict="unexplained", reason="one", proposals=(law,), tried=(rival,), hand="shadow_hand")
    return plain({"schema": 1, **found.model_dump()})


@pytest.fixture
def ladder() -> dict[str, Any]:
    """A ladder of one step as `twin ladder` writes it."""
    start = {"effect": None, "target": None, "joints": [], "parameters": {}, "mse_rad2": 1e-3,
             "holdout_mse_rad2": 2e-3, "verdict": "explained", "together": False}  # fmt: skip
    first = {"effect": "viscous_friction", "target": "rh_FFJ3", "joints": ["rh_FFJ3"], "parameters": {"damping": 0.6},
             "mse_rad2": 1e-6, "holdout_mse_rad2": None, "verdict": "within_noise", "together": False}  # fmt: skip
    nothing = {"mse_rad2": None, "holdout_mse_rad2": None}
    return {
        "schema": 1, "hand": "shadow_hand", "verdict": "within_noise", "reason": "nothing is left",
        "steps": [start, first], "refused": ["backlash:rh_FFJ1"], "noise_floor_rad2": 1e-8, "interrupted": False,
        "references": {"raw_command": {"mse_rad2": 5e-3, "holdout_mse_rad2": 6e-3}, "last_promoted": nothing,
                       "parameters_alone": nothing},
        "parent": None, "version": None, "notes": [], "seed": 3, "parameters": {},
    }  # fmt: skip


def written(path: Path, content: dict[str, Any]) -> str:
    path.write_text(json.dumps(content), encoding="utf-8")
    return str(path)


@dataclass
class Page(HTMLParser):
    """What a browser would find: elements with their attributes, the text of scripts, and the words that are shown."""

    html: str
    elements: list[tuple[str, dict[str, str | None]]] = field(default_factory=list)
    scripts: list[str] = field(default_factory=list)
    words: str = ""
    _inside: str = ""

    def __post_init__(self) -> None:
        super().__init__()
        self.feed(self.html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        self._inside = tag
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag: str) -> None:
        self._inside = ""

    def handle_data(self, data: str) -> None:
        if self._inside == "script":
            self.scripts[-1] += data
        elif self._inside != "style":
            self.words += data

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]

    @property
    def run(self) -> list[str]:
        """The scripts that a browser runs: those that are not data."""
        pairs = zip(self.all("script"), self.scripts, strict=True)
        return [text for attributes, text in pairs if attributes.get("type") != "application/json"]

    @property
    def sections(self) -> list[str | None]:
        return [attributes.get("id") for attributes in self.all("section")]


def report(folder: Path, *argv: str) -> tuple[Page, dict[str, Any]]:
    """(the page, the JSON) of a `twin report` that must succeed."""
    path, result = folder / "report.html", folder / "report.json"
    assert main(["report", *argv, "-o", str(path), "--json", str(result)]) == 0
    return Page(path.read_text(encoding="utf-8")), json.loads(result.read_text(encoding="utf-8"))


@pytest.fixture(scope="session")
def plain_report(bag: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Page, dict[str, Any]]:
    """The page of the recording alone, with the nominal model."""
    return report(tmp_path_factory.mktemp("report"), "--recording", str(bag))
