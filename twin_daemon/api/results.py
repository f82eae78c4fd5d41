"""What the functions return: the content of each command's JSON, typed, with a table and a figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Self

from pydantic import BaseModel, ConfigDict, PrivateAttr

from twin_daemon.diagnosis import verdict
from twin_daemon.jsonable import plain
from twin_daemon.tables import slim_table

if TYPE_CHECKING:
    import plotly.graph_objects as go  # pyright: ignore[reportMissingTypeStubs]
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
    """A mean squared error."""

    mse_rad2: float | None
    """In rad²; None where no joint moves."""


class JointError(BaseModel):
    """One joint's error. Positive bias: it reads more than predicted; positive lag: it comes later."""

    mse_rad2: float
    """Mean squared residual."""
    rmse_rad: float
    """Its root."""
    max_abs_rad: float
    """The largest residual."""
    bias_rad: float
    """The mean residual; positive: the joint reads more than predicted."""
    lag_s: float | None
    """By how much the joint comes later than predicted; None where that cannot be told."""
    noise_rad2: float
    """What the sensor's noise and resolution alone would leave."""
    moves: bool
    """Whether it moved enough to count in the means."""


class Comparison(Result):
    """The twin against measurements: means over the joints that move, and each joint's errors."""

    hand: str
    """The robot's name."""
    version: str | None
    """The version that was compared; None for terms from a file."""
    mse_rad2: float | None
    """Mean over the joints that move; None where none does."""
    noise_floor_rad2: float | None
    """What no model can go below, over the same joints."""
    joints: dict[str, JointError]
    """By joint."""
    groups: dict[str, Mse]
    """By group of joints, such as `FF` or `thumb`."""
    references: dict[str, Mse]
    """The same error of `raw_command` and `last_promoted`."""

    _compared: Sequence[Compared] = PrivateAttr(default=())

    @classmethod
    def of(cls, payload: Mapping[str, Any], compared: Sequence[Compared]) -> Self:
        made = cls.made_of(payload)
        made._compared = compared
        return made

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
    """`identifiable`, `weak` or `not_identifiable`."""
    identifiable: bool
    """Whether a fit would tell its value."""
    unit: str
    """The parameter's unit."""
    ci95_width: float | None
    """Width of the 95 % interval that a fit would give, in `unit`."""
    confused_with: str | None
    """The parameter that it cannot be told from."""
    advice: str | None
    """The motion that would change that."""


class Check(Result):
    """What recordings can and cannot tell, before anyone fits."""

    hand: str
    """The robot's name."""
    space: str
    """The space whose parameters were looked at."""
    recordings: list[dict[str, Any]]
    """Rate, jitter, gaps and still joints of each recording."""
    parameters: dict[str, Prospect]
    """By parameter."""

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
    """The value, in `unit`."""
    unit: str
    """Its unit."""
    ci95: tuple[float | None, float | None]
    """The 95 % interval, in `unit`; None where it is unknown."""
    at_bound: bool = False
    """Whether it ended on a bound."""


class _Judged(Result):
    """Errors before and after, on what was fitted and on what was held out, and the version that was stored."""

    before: Mse
    """Error on what was fitted, before."""
    after: Mse
    """The same after."""
    holdout_before: Mse
    """Error on validation data, before."""
    holdout_after: Mse
    """The same after."""
    parameters: dict[str, Fitted]
    """By parameter."""
    version: str
    """Id of the version that was stored."""
    candidate: bool
    """Whether it became the candidate, which it does if it is better on validation data."""
    notes: list[str]
    """What to know of the fit."""

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
    """Roll-outs that were taken."""
    wall_s: float
    """Time that it took."""
    history: list[Any]
    """The best mean squared error (rad²) by evaluation."""


class Addition(_Judged):
    """An effect in the twin. `terms` are those of the stored version."""

    effect: str
    """Key of the effect."""
    targets: list[str]
    """Where it acts."""
    holdout_joints_before: Mse
    """Error on validation data over the effect's joints, before."""
    holdout_joints_after: Mse
    """The same after."""
    terms: dict[str, Any]
    """Effects and parameters of the stored version."""


class Diagnosis(Result):
    """Which effects the twin lacks, with their evidence; `verdict` is the answer in one word."""

    verdict: verdict.VerdictName
    """The answer in one word."""
    reason: str
    """The answer in a sentence."""
    findings: list[verdict.Finding]
    """The effects that the data ask for, the best first."""
    tried: list[verdict.Trial]
    """Every other candidate, and why it lost."""
    where: list[verdict.Failure]
    """Joints and conditions where the model fails most."""
    next_experiment: verdict.Experiment | None
    """The motion that would settle what is open."""
    wall_s: float
    """Time that it took."""

    _robot: Robot | None = PrivateAttr(default=None)

    @classmethod
    def of(cls, payload: Mapping[str, Any], robot: Robot) -> Self:
        made = cls.made_of(payload)
        made._robot = robot
        return made

    @property
    def of_robot(self) -> Robot | None:
        """The robot that was diagnosed; None for a result that was read from a file."""
        return self._robot

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
    """The robot's name."""
    verdict: verdict.VerdictName | None
    """What the last diagnosis said; None where it was cut short."""
    reason: str
    """The same in a sentence."""
    steps: list[verdict.Step]
    """The twin as it was, then after each effect."""
    references: dict[str, verdict.ReferenceErrors]
    """Errors to compare with, such as `raw_command` and `parameters_alone`."""
    noise_floor_rad2: float | None
    """What no model can go below."""
    version: str | None
    """Id of the version that was stored."""

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
    """The hash of its content."""
    names: list[str]
    """The names that point at it."""


class Versions(Result):
    """Every version of a hand, `nominal` first, and the names that point at them."""

    hand: str
    """The robot's name."""
    versions: list[Version]
    """Every version, `nominal` first, then the oldest."""
    aliases: dict[str, str]
    """The version that each name points at."""

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
    errors: Mapping[str, Any] = version.get("errors") or {}
    after: Mapping[str, float] = errors.get("holdout_after") or {}
    return after.get("mse_rad2")


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _bars(title: str, series: Mapping[str, Mapping[str, float | None]], *, log: bool) -> go.Figure:
    """Bars of several series by name."""
    import plotly.graph_objects as go  # pyright: ignore[reportMissingTypeStubs]

    from twin_daemon.figures.style import styled

    figure = go.Figure([go.Bar(name=name, x=list(values), y=list(values.values())) for name, values in series.items()])
    figure = styled(figure, title, height=420)
    figure.update_yaxes(type="log" if log else "linear")  # pyright: ignore[reportUnknownMemberType]
    return figure
