"""The page itself: one HTML file that asks nobody for anything."""

from __future__ import annotations

import base64
import hashlib
import math
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import jinja2
import plotly.offline
from markupsafe import Markup

from twin_daemon.diagnosis.verdict import IN_WORDS, Diagnosis, Finding, LadderResult
from twin_daemon.figures.drawings import drawing
from twin_daemon.figures.history import history_figure
from twin_daemon.figures.ladder import ladder_figure
from twin_daemon.figures.law import law_figure
from twin_daemon.figures.style import DARK
from twin_daemon.figures.waterfall import waterfall_figure
from twin_daemon.proposals.proposal import Proposals
from twin_daemon.report import words
from twin_daemon.report.chart import Chart, chart, in_script
from twin_daemon.report.motion import Motion, conditions, overlays
from twin_daemon.report.parameters import ParameterRow
from twin_daemon.report.reproduce import Recipe
from twin_daemon.versions import Version
from twin_daemon.versions.history import Series
from twin_daemon.versions.history_words import heading

_TEMPLATES = Path(__file__).with_name("templates")
_MOST_TRIED = 20  # candidates that are shown at once


@dataclass(frozen=True)
class Content:
    """What a page tells. `motions` are the recordings, and the held-out ones where there are any."""

    hand: str
    motions: tuple[Motion, ...]
    version: Version | None
    parameters: tuple[ParameterRow, ...]
    recipe: Recipe
    diagnosis: Diagnosis | None = None
    ladder: LadderResult | None = None
    proposals: Proposals | None = None
    candidates: tuple[Finding, ...] = ()
    """Findings about this very twin, whose predictions are drawn."""
    steps: tuple[tuple[str, float], ...] = ()
    """What was added from the nominal model to this one, and the mean squared error (rad^2) after it; see waterfall."""
    steps_held_out: bool = False
    notes: tuple[str, ...] = field(default=())
    history: tuple[Series, ...] = ()
    """Parameters and values of effects over the versions that were promoted, the most urgent first."""

    @property
    def sections(self) -> tuple[str, ...]:
        """The ids of the page's sections, in order."""
        moves = any(motion.rows for motion in self.motions)
        there = {
            "summary": True,
            "comparison": True,
            "motion": moves,
            "conditions": moves,
            "diagnosis": self.diagnosis is not None,
            "proposals": self.proposals is not None,
            "ladder": self.ladder is not None,
            "parameters": True,
            "history": bool(self.history),
            "reproduce": True,
        }
        return tuple(name for name, shown in there.items() if shown)


def render(content: Content) -> str:
    """The page as text. Whatever comes from recordings, versions and results is escaped."""
    plotly_js, page_js = (_one_ending(text) for text in (plotly.offline.get_plotlyjs(), _text("page.js")))
    return _environment().get_template("page.html.j2").render(
        policy=_policy(plotly_js, page_js),
        css=Markup(style()),
        plotly_js=Markup(plotly_js),
        page_js=Markup(page_js),
        colours=in_script(DARK),
        made=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        content=content,
        sections=content.sections,
        overlays=overlays(content.motions),
        conditions=conditions(content.motions, content.candidates),
        **(_about(content.diagnosis) if content.diagnosis else {}),
        ladder_chart=ladder_chart(content.ladder) if content.ladder else None,
        law_charts=law_charts(content.proposals) if content.proposals else [],
        fall=fall_chart(content) if len(content.steps) > 1 else None,
        history_chart=history_chart(content) if content.history else None,
        heading=heading,
        verdicts=IN_WORDS,
    )  # fmt: skip


def style() -> str:
    """The style sheet, for other pages that shall look alike."""
    return _text("page.css")


def diagnosis_section(found: Diagnosis) -> Markup:
    """The section on a diagnosis alone, for other pages. What comes from the result is escaped."""
    template = _environment().get_template("section_diagnosis.html.j2")
    return Markup(template.render(content={"diagnosis": found}, **_about(found)))


def _about(found: Diagnosis) -> dict[str, Any]:
    tried = sorted(found.tried, key=lambda trial: -trial.evidence_nats if math.isfinite(trial.evidence_nats) else 0.0)
    return {"tried": tried, "most_tried": _MOST_TRIED}


def ladder_chart(ladder: LadderResult) -> Chart:
    """The figure of a ladder."""
    plain: dict[str, Any] = ladder.model_dump()
    steps = [
        {**step, "parameters": {name: value for name, value in step["parameters"].items() if value is not None}}
        for step in plain["steps"]
    ]
    figure = ladder_figure("", steps, plain["references"], ladder.noise_floor_rad2)
    figure.update_layout(height=460)
    return chart("ladder-figure", figure, "The error by what was added, on fitted and on held-out motion.")


def law_charts(found: Proposals) -> list[Chart]:
    """The curve of each proposed law with its band, and where the motion has been."""
    charts = []
    for number, law in enumerate(found.proposals):
        words = f"{law.port} over {' x '.join(law.variables)}: the curve of the law with its 95 % band."
        charts.append(chart(f"law-{number}", law_figure(law.curve, f"{law.port} ({law.curve.unit})"), words))
    return charts


def fall_chart(content: Content) -> Chart:
    """The waterfall from the nominal model to this one."""
    noise = content.motions[0].report["noise_floor_rad2"]
    words = (
        "The rms error of the nominal model, by how much each addition changes it, what is left, the sensors' noise."
    )
    return chart("fall", waterfall_figure(content.steps, noise), words, legend=False)


def history_chart(content: Content) -> Chart:
    """The series that the history shows, each with its band."""
    said = (
        "Values over the promoted versions: points with 95 % intervals, the smoothed level with its band, jumps dotted."
    )
    return chart("history-figure", history_figure(content.hand, content.history), said)


def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    for tool in (words.number, words.milli, words.percent, words.root, words.interval):
        environment.filters[tool.__name__] = tool
    environment.globals.update(drawing=lambda key: Markup(drawing(key, key.replace("_", " "))))
    environment.globals.update(how_sure=words.how_sure, left_over=words.left_over, bounds=words.bounds)
    return environment


def _policy(*scripts: str) -> str:
    """A Content-Security-Policy that runs these scripts and no others, and forbids every request."""
    allowed = " ".join(f"'sha256-{base64.b64encode(hashlib.sha256(s.encode()).digest()).decode()}'" for s in scripts)
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )


def _text(name: str) -> str:
    return (_TEMPLATES / name).read_text(encoding="utf-8")


def _one_ending(script: str) -> str:
    """As a browser reads it: the hash of a script is that of the text with plain line ends."""
    return script.replace("\r\n", "\n").replace("\r", "\n")
