"""What the functions return: the content of each command's JSON, typed, with a table and a figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Self

from pydantic import BaseModel, ConfigDict, PrivateAttr

from twin_daemon.cli.tables import slim_table
from twin_daemon.diagnosis import verdict
from twin_daemon.jsonable import plain

if TYPE_CHECKING:
    import plotly.graph_objects as go
    from rich.table import Table

    from twin_daemon.api.inputs import Robot
    from twin_daemon.comparison.compare import Comparison as Compared


class Result(BaseModel):
    """The content of a command's JSON. Fields that are not declared here are attributes as well."""

    model_config = ConfigDict(frozen=True, extra="allow")

    _payload: dict[str, Any] = PrivateAttr(default_factory=dict)

    @classmethod
    def made_of(cls, payload: Mapping[str, Any]) -> Self:
        """The result of what a command would write."""
        content = {"schema": 1, **plain(payload)}
        found = cls.model_validate({key: value for key, value in content.items() if key != "schema"})
        found._payload = content
        return found

    def as_json(self) -> dict[str, Any]:
        """The object that the command writes with --json: plain values, None for what nobody knows."""
        return self._payload

    def table(self) -> Table:
        """The result for people."""
        raise NotImplementedError

    def figure(self) -> go.Figure:
        """The result as a picture."""
        raise NotImplementedError


class Mse(BaseModel):
    """A mean squared error in rad^2; None where there is no motion to judge by."""

    mse_rad2: float | None


class JointError(BaseModel):
    """One joint's error. Positive bias: it reads more than predicted; positive lag: it comes later."""

    mse_rad2: float
    rmse_rad: float
    max_abs_rad: float
    bias_rad: float
    lag_s: float | None
    noise_rad2: float
    moves: bool


class Comparison(Result):
    """The twin against measurements: means over the joints that move, and each joint's errors."""

    hand: str
    version: str | None
    mse_rad2: float | None
    noise_floor_rad2: float | None
    joints: dict[str, JointError]
    groups: dict[str, Mse]
    references: dict[str, Mse]

    _compared: Sequence[Compared] = PrivateAttr(default=())

    def table(self) -> Table:
        table = slim_table(f"{self.hand}: measured against twin", ("joint", "rmse mrad", "max mrad", "bias mrad"))
        for name, joint in self.joints.items():
            if joint.moves:
                values = (joint.rmse_rad, joint.max_abs_rad, joint.bias_rad)
                table.add_row(name, *(f"{1e3 * value:.3g}" for value in values))
        return table

    def figure(self, recording: int = 0) -> go.Figure:
        """Measured, twin and residual over time, of one of the recordings by its place."""
        from twin_daemon.figures.comparison import comparison_figure

        return comparison_figure(self._compared[recording])


class Prospect(BaseModel):
    """What a recording says of one parameter: `identifiable`, `weak` or `not_identifiable`; the width in `unit`."""

    verdict: str
    identifiable: bool
    unit: str
    ci95_width: float | None
    confused_with: str | None
    advice: str | None


class Check(Result):
    """What recordings can and cannot tell, before anyone fits."""

    hand: str
    space: str
    recordings: list[dict[str, Any]]
    parameters: dict[str, Prospect]

    def table(self) -> Table:
        table = slim_table(f"what '{self.space}' would get", ("parameter", "95 % width", "unit", "the data say"))
        for name, one in self.parameters.items():
            table.add_row(name, _number(one.ci95_width), one.unit, one.verdict.replace("_", " "))
        return table

    def figure(self) -> go.Figure:
        """The width of each parameter's interval, in its own unit."""
        widths = {name: one.ci95_width for name, one in self.parameters.items()}
        return _bars("Width of the 95 % intervals, each in its unit", {"width": widths}, log=True)


class Fitted(BaseModel):
    """One fitted value in `unit`, its 95 % interval and the bounds that it was looked for within."""

    model_config = ConfigDict(extra="allow")

    value: float
    unit: str
    ci95: tuple[float | None, float | None]
    at_bound: bool = False


class _Judged(Result):
    """Errors before and after, on what was fitted and on what was held out, and the version that was stored."""

    before: Mse
    after: Mse
    holdout_before: Mse
    holdout_after: Mse
    parameters: dict[str, Fitted]
    version: str
    candidate: bool
    notes: list[str]

    def table(self) -> Table:
        table = slim_table("fitted", ("parameter", "value", "95 % interval", "unit"))
        for name, one in self.parameters.items():
            table.add_row(name, f"{one.value:.4g}", f"{_number(one.ci95[0])} .. {_number(one.ci95[1])}", one.unit)
        return table

    def figure(self) -> go.Figure:
        """The errors before and after."""
        stages = {"before": (self.before, self.holdout_before), "after": (self.after, self.holdout_after)}
        series = {
            when: {"fitted": fitted.mse_rad2, "held out": held.mse_rad2} for when, (fitted, held) in stages.items()
        }
        return _bars("Mean squared error (rad²)", series, log=True)


class Calibration(_Judged):
    """Fitted parameters. `history` is the best mean squared error (rad^2) by evaluation."""

    evaluations: int
    wall_s: float
    history: list[Any]


class Addition(_Judged):
    """An effect in the twin. `terms` are those of the stored version."""

    effect: str
    targets: list[str]
    holdout_joints_before: Mse
    holdout_joints_after: Mse
    terms: dict[str, Any]


class Diagnosis(Result):
    """Which effects the twin lacks, with their evidence; `verdict` is the answer in one word."""

    verdict: verdict.VerdictName
    reason: str
    findings: list[verdict.Finding]
    tried: list[verdict.Trial]
    where: list[verdict.Failure]
    next_experiment: verdict.Experiment | None
    wall_s: float

    _robot: Robot | None = PrivateAttr(default=None)

    def table(self) -> Table:
        table = slim_table(self.reason, ("found", "value", "95 % interval", "unit"))
        for finding in self.findings:
            for name, one in finding.parameters.items():
                span = f"{one.ci95[0]:.4g} .. {one.ci95[1]:.4g}"
                table.add_row(f"{finding.effect} at {finding.target}: {name}", f"{one.value:.4g}", span, one.unit)
        return table

    def figure(self) -> go.Figure:
        """The evidence of each candidate in nats."""
        every = [*self.findings, *self.tried]
        found = {f"{one.effect}:{one.target}": one.evidence_nats for one in every}
        return _bars("Evidence over the model alone (nats)", {"evidence": found}, log=False)


class Ladder(Result):
    """The error by what was added, and the version with all of it; None where nothing was."""

    hand: str
    verdict: verdict.VerdictName | None
    reason: str
    steps: list[verdict.Step]
    references: dict[str, verdict.ReferenceErrors]
    noise_floor_rad2: float | None
    version: str | None

    def table(self) -> Table:
        table = slim_table("the error by what was added", ("step", "fitted rad²", "held out rad²", "then it is"))
        for number, step in enumerate(self.steps):
            name = step.name if step.effect else "all values together" if step.together else "start"
            errors = (_number(step.mse_rad2), _number(step.holdout_mse_rad2))
            table.add_row(f"{number} {name}", *errors, (step.verdict or "-").replace("_", " "))
        return table

    def figure(self) -> go.Figure:
        """The error by step, beside the references."""
        from twin_daemon.figures.ladder import ladder_figure

        payload = self.as_json()
        return ladder_figure(self.hand, payload["steps"], payload["references"], self.noise_floor_rad2)


class Version(BaseModel):
    """One version of a hand's twin."""

    model_config = ConfigDict(extra="allow")

    id: str
    names: list[str]


class Versions(Result):
    """Every version of a hand, `nominal` first, and the names that point at them."""

    hand: str
    versions: list[Version]
    aliases: dict[str, str]

    def table(self) -> Table:
        table = slim_table(f"{self.hand}: versions", ("version", "names"))
        for one in self.versions:
            table.add_row(one.id[:12], ", ".join(one.names))
        return table

    def figure(self) -> go.Figure:
        """The held-out error (rad^2) that each version was stored with."""
        errors = {one["id"][:12]: _held_out(one) for one in self.as_json()["versions"]}
        return _bars("Held-out mean squared error (rad²)", {"held out": errors}, log=True)


def _held_out(version: Mapping[str, Any]) -> float | None:
    return ((version.get("errors") or {}).get("holdout_after") or {}).get("mse_rad2")


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _bars(title: str, series: Mapping[str, Mapping[str, float | None]], *, log: bool) -> go.Figure:
    """Bars of several series by name."""
    import plotly.graph_objects as go

    from twin_daemon.figures.style import styled

    figure = go.Figure([go.Bar(name=name, x=list(values), y=list(values.values())) for name, values in series.items()])
    return styled(figure, title, height=420).update_yaxes(type="log" if log else "linear")
