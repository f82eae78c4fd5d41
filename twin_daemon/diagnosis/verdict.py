"""What a diagnosis and a ladder say, as they are written and read: verdicts are values, findings carry their evidence.

Numbers that nobody knows are NaN here and null in JSON.
"""

from __future__ import annotations

from typing import Any, Literal

from pydantic import AliasChoices, BaseModel, ConfigDict, Field, field_serializer

from twin_daemon.diagnosis.thresholds import DEVIATING_SIGMA
from twin_daemon.estimation.estimate import Estimate, Number
from twin_daemon.simulation.terms import EffectTerm, Terms

VerdictName = Literal["explained", "ambiguous", "not_excited", "unexplained", "within_noise"]

IN_WORDS = {
    "explained": "Explained: the library has what the twin lacks.",
    "ambiguous": "Ambiguous: more than one effect explains these data equally well.",
    "not_excited": "Not excited: this motion cannot show what the twin lacks.",
    "unexplained": "Unexplained: something is missing that no effect of the library accounts for.",
    "within_noise": "Within noise: these data ask for no further effect.",
}
_ENDED_EARLY = "Not explained yet: the search was ended before it was through."


class _Said(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore", populate_by_name=True)


def _short_named(name: str) -> Any:
    """A field without its unit in JSON, as the others of a finding; None where it is unknown."""
    return Field(default=None, validation_alias=name, serialization_alias=name)


class MotionError(_Said):
    """The errors of one held-out recording in short pieces, without an effect and with it, in rad^2."""

    name: str
    """The recording."""
    mse_before_rad2: Number = Field(validation_alias="mse_before", serialization_alias="mse_before")
    """Without the effect."""
    mse_after_rad2: Number = Field(validation_alias="mse_after", serialization_alias="mse_after")
    """With it."""
    gain_ci95: tuple[Number, Number]
    """95 % interval of the share that it takes away."""
    left: Number
    """What the worst joint leaves, in what a right model may leave."""


class Finding(_Said):
    """One effect that the data ask for, with its errors on validation data.

    It is validated by those in short pieces; those of free roll-outs are what `twin add` reports when it takes the
    finding over.
    """

    effect: str
    """Key of the effect."""
    target: str
    """Its place: a joint, a command, `hand` or `robot`."""
    joints: tuple[str, ...]
    """The joints that it acts on."""
    parameters: dict[str, Estimate]
    """The values that were fitted."""
    evidence_nats: Number = Field(validation_alias="evidence", serialization_alias="evidence")
    """Gain of log posterior over the model alone, in nats; `evidence` in JSON."""
    holdout_mse_before_rad2: Number = Field(
        validation_alias="holdout_mse_before", serialization_alias="holdout_mse_before"
    )
    """Error on validation data without it, in short pieces of its part."""
    holdout_mse_after_rad2: Number = Field(
        validation_alias="holdout_mse_after", serialization_alias="holdout_mse_after"
    )
    """The same with it."""
    holdout_gain: Number
    """The share of that error which it takes away."""
    holdout_gain_ci95: tuple[Number, Number]
    """95 % interval of that share."""
    holdout_motions: tuple[MotionError, ...] = ()
    """The same of each recording that judged it: the worst of them decides whether the effect is right."""
    confusable_with: tuple[str, ...]
    """What it may be instead, as `effect:place`."""
    rivals: tuple[EffectTerm, ...] = ()
    """The same with the values that were fitted, where each was fitted by itself."""
    explanation: str
    """The finding in a sentence."""
    probability: float | None = None
    """Of this effect at this place, among all causes."""
    values: dict[str, float] = {}
    """All values of the effect, fitted or not."""
    moved: dict[str, float] = {}
    """The model's own parameters as they were fitted beside it, by name."""
    free_holdout_mse_before_rad2: float | None = _short_named("free_holdout_mse_before")
    """Error on validation data without it, in one free roll-out of the whole hand."""
    free_holdout_mse_after_rad2: float | None = _short_named("free_holdout_mse_after")
    """The same with it."""
    free_holdout_joints_mse_before_rad2: float | None = _short_named("free_holdout_joints_mse_before")
    """Error of that roll-out over the joints of the effect, without it."""
    free_holdout_joints_mse_after_rad2: float | None = _short_named("free_holdout_joints_mse_after")
    """The same with it."""

    @property
    def term(self) -> EffectTerm:
        """The effect at its place with its values."""
        values = self.values or {name: one.value for name, one in self.parameters.items()}
        return EffectTerm(effect=self.effect, target=self.target, values=values)

    @property
    def name(self) -> str:
        """The effect and its place, as findings name each other."""
        return f"{self.effect}:{self.target}"

    @field_serializer("parameters")
    def _without_unknowns(self, parameters: dict[str, Estimate]) -> dict[str, dict]:
        return {name: one.model_dump(exclude_none=True) for name, one in parameters.items()}


class Trial(_Said):
    """A candidate and why it did not win. Evidence is its gain over the model alone."""

    effect: str
    """Key of the effect."""
    target: str
    """Its place."""
    evidence_nats: Number = Field(validation_alias="evidence", serialization_alias="evidence")
    """As of a finding."""
    fit_mse_rad2: float | None
    """Error on what was fitted; None where it was not fitted to the end."""
    holdout_mse_rad2: float | None
    """Error on validation data; None where it was not tested."""
    left_times_floor: float | None = None
    """What it leaves of what was fitted, in floors, with the price of what is off beside it; None as above."""
    lost_because: str
    """Why it is no finding."""


class Failure(_Said):
    """Where the model fails: a joint, what it was doing, and the error there beside the joint's own average."""

    joint: str
    """The joint."""
    condition: str
    """What it was doing: a hold, a reversal, a direction, a speed, a part of its travel."""
    rmse_rad: Number
    """Root mean square residual there."""
    bias_rad: Number
    """Mean residual there."""
    times_average: Number
    """That root over the joint's own average."""
    seconds: Number
    """For how long it was so."""


class PartSummary(_Said):
    """One part of the hand: what the model leaves of its floor, at first and with what was found."""

    joints: tuple[str, ...]
    times_floor: Number
    left_times_floor: Number
    adequacy: Number = float("nan")
    """What is left in what a right model may leave, uncertain values that are too far off among it."""
    above: bool = False
    """Whether it is above its floor without what was found."""
    named: bool = False
    """Whether anything was found there."""
    unknown: Number = float("nan")
    """Probability that it lacks what is no law of the library."""
    within_floor: bool = Field(validation_alias=AliasChoices("within_floor", "quiet"))
    """`quiet` in files of earlier versions."""


class MovedParameter(_Said):
    """A nominal parameter that came to lie elsewhere: how many sigma, and its ratio to nominal with an interval.

    `known_to` is what nominal values of its kind are known to, as a share; None where it is no factor.
    """

    parameter: str
    sigma: Number
    of_nominal: float | None = None
    of_nominal_ci95: tuple[float, float] | None = None
    known_to: float | None = None

    def __str__(self) -> str:
        if self.of_nominal is None or self.of_nominal_ci95 is None or self.known_to is None:
            return f"{self.parameter} sits {self.sigma:+.1f} sigma from the model's value"
        low, high = self.of_nominal_ci95
        beyond = "beyond" if abs(self.sigma) > DEVIATING_SIGMA else "not beyond"
        return (
            f"{self.parameter} is {self.of_nominal:.2f} of nominal ({low:.2f} to {high:.2f}): "
            f"{beyond} what nominal values are known to ({self.known_to:.0%})"
        )


class Probability(_Said):
    """How probable a set of causes is: effects with their places, or "nothing", or "unknown" for none of the library.

    Where nothing is missing that could be seen, "too_weak" is something that these data are too weak to show. Only what
    is above 1 % is listed, so that the sum may be a little less than 1.
    """

    effects: tuple[str, ...]
    probability: Number

    @property
    def in_words(self) -> str:
        """The causes without their probability."""
        names = {
            "nothing": "nothing is missing",
            "unknown": "a law that is not in the library",
            "too_weak": "something that these data are too weak to show",
        }
        return " and ".join(names.get(name, name.replace(":", " at ")) for name in self.effects)

    def __str__(self) -> str:
        return f"{self.in_words}: {in_hundred(self.probability)}"


def in_hundred(probability: float) -> str:
    """A probability as one would bet on it: '97 in 100'."""
    if probability > 0.995:
        return "more than 99 in 100"
    return f"{100 * probability:.0f} in 100"


class Experiment(_Said):
    """The motion that would settle an open question, in a trajectory file."""

    path: str
    """The trajectory file."""
    trajectory: str
    """Its name in the file."""
    expected_difference_rad: float | None
    """Rms difference that the candidates predict; None where nothing was compared."""
    separates: tuple[str, ...]
    """The candidates that it tells apart."""
    motion: str = ""
    """The kind of motion."""
    considered: dict[str, Number] = {}
    """The motions that were compared, with their differences."""
    why: str
    """Why this one, in a sentence."""


class RecordingRead(_Said):
    """A recording by where it was, its name and its bytes."""

    path: str
    name: str
    sha256: str


class Diagnosis(_Said):
    """The whole answer. `hand`, `version` and `seed` are those of the command that wrote it.

    `terms` are those of the twin that was diagnosed, `fitted_on` and `held_out_on` the recordings; the latter is empty
    where stretches of the former were held out.
    """

    format: Literal[1] = Field(default=1, validation_alias="schema", exclude=True)
    verdict: VerdictName
    reason: str
    findings: tuple[Finding, ...]
    probabilities: tuple[Probability, ...] = ()
    causes: tuple[dict[str, float], ...] = ()
    """For each place among the causes what may be there, by probability, given that it is of the library."""
    tried: tuple[Trial, ...]
    where: tuple[Failure, ...]
    parts: dict[str, PartSummary]
    moved_parameters: tuple[MovedParameter, ...] = ()
    next_experiment: Experiment | None = None
    interrupted: bool = False
    notes: tuple[str, ...] = ()
    hand: str | None = None
    version: str | None = None
    seed: int | None = None
    terms: Terms | None = None
    fitted_on: tuple[RecordingRead, ...] = ()
    held_out_on: tuple[RecordingRead, ...] = ()

    @classmethod
    def without_findings(cls, verdict: VerdictName, reason: str) -> Diagnosis:
        """An answer that rests on no fit."""
        return cls(verdict=verdict, reason=reason, findings=(), tried=(), where=(), parts={})

    @property
    def in_words(self) -> str:
        """The verdict as a sentence. Of a search that was ended early nobody can say that something is unexplained."""
        return _ENDED_EARLY if self.interrupted and self.verdict == "unexplained" else IN_WORDS[self.verdict]


class Step(_Said):
    """The twin after one more effect, and what the diagnosis says of it then.

    `effect` is None in the first step, and in one that fits the values of all effects and parameters `together`.
    Errors are over the joints that move. `parameters` are the effect's fitted values, `confusable_with` what the data
    did not tell it from.
    """

    effect: str | None
    """Key of the effect that was added."""
    target: str | None
    """Its place."""
    joints: tuple[str, ...] = ()
    """The joints that it acts on."""
    parameters: dict[str, Number]
    """Its fitted values."""
    mse_rad2: float | None
    """Error on what was fitted, in one free roll-out."""
    holdout_mse_rad2: float | None
    """Error on validation data."""
    verdict: VerdictName | None
    """What the diagnosis said then."""
    together: bool = False
    """Whether all values were fitted together in this step."""
    confusable_with: tuple[str, ...] = ()
    """What it may be instead."""

    @property
    def name(self) -> str:
        """The effect and where, with what it may be instead."""
        instead = f" (or {', '.join(self.confusable_with)})" if self.confusable_with else ""
        return f"{self.effect} at {self.target}{instead}"

    def better_than(self, other: Step) -> bool:
        """Whether held-out motion is predicted better."""
        new, old = self.holdout_mse_rad2, other.holdout_mse_rad2
        return new is not None and old is not None and new < old


class ReferenceErrors(_Said):
    """What a predictor leaves that a ladder is compared with."""

    mse_rad2: float | None = None
    """Error on what was fitted."""
    holdout_mse_rad2: float | None = None
    """Error on validation data."""


class LadderResult(_Said):
    """What `twin ladder` writes, as far as a page shows it."""

    format: Literal[1] = Field(default=1, validation_alias="schema", exclude=True)
    hand: str
    verdict: VerdictName | None
    reason: str
    steps: tuple[Step, ...] = Field(min_length=1)
    refused: tuple[str, ...] = ()
    references: dict[str, ReferenceErrors]
    noise_floor_rad2: float | None
    parent: str | None = None
    version: str | None = None
    notes: tuple[str, ...] = ()
    seed: int | None = None
