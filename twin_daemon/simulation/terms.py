"""The terms of a twin: what is changed on top of the hand's nominal model. Keys and numbers, never code."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from twin_daemon.effects import LIBRARY
from twin_daemon.errors import BadInput
from twin_daemon.places import ROBOT
from twin_daemon.yaml_files import load_yaml


class EffectTerm(BaseModel):
    """One effect at one place, with its values by parameter name (units as the effect declares them)."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    effect: str
    target: str = Field(description="joint or command name as in the data, 'hand', or 'robot': each servo alike")
    values: dict[str, float] = {}


class Terms(BaseModel):
    """Absolute parameter values ("rh_FFJ3.damping": 0.2) and effects. Empty terms are the nominal model."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal[1] = Field(default=1, alias="schema")
    parameters: dict[str, float] = {}
    effects: tuple[EffectTerm, ...] = ()

    def with_effect(self, term: EffectTerm) -> Terms:
        """These terms with one effect added; the same effect at the same place is replaced."""
        kept = tuple(t for t in self.effects if (t.effect, t.target) != (term.effect, term.target))
        return Terms(parameters=self.parameters, effects=(*kept, term))

    def written_out(self, servos: Sequence[str], joints: Sequence[str]) -> Terms:
        """These terms with each effect of the whole robot written out: the same at every servo, or at every joint."""
        if not any(term.target == ROBOT for term in self.effects):
            return self
        found = Terms(parameters=self.parameters)
        for term in self.effects:
            for target in _everywhere(term, servos, joints) if term.target == ROBOT else (term.target,):
                found = found.with_effect(term.model_copy(update={"target": target}))
        return found

    def is_everywhere(self, term: EffectTerm, servos: Sequence[str], joints: Sequence[str]) -> bool:
        """Whether each of several servos, or joints, has this effect with the same values: one cause of the robot."""
        places = _everywhere(term, servos, joints)
        alike = {t.target for t in self.effects if (t.effect, t.values) == (term.effect, term.values)}
        return len(places) > 1 and term.target in places and set(places) <= alike

    def without_effect(self, effect: str, targets: set[str]) -> Terms:
        """These terms with an effect removed at the given places."""
        kept = tuple(t for t in self.effects if not (t.effect == effect and t.target in targets))
        return Terms(parameters=self.parameters, effects=kept)

    def with_parameters(self, parameters: dict[str, float]) -> Terms:
        """These terms with some parameters set."""
        return Terms(parameters={**self.parameters, **parameters}, effects=self.effects)

    def as_json(self) -> dict:
        """A plain object that `Terms.model_validate` reads back."""
        return self.model_dump(by_alias=True, mode="json")


def _everywhere(term: EffectTerm, servos: Sequence[str], joints: Sequence[str]) -> Sequence[str]:
    """Where an effect of the whole robot is. What no library has is refused where the model is built."""
    effect = LIBRARY.get(term.effect)
    return joints if effect is not None and effect.shared == "joints" else servos


def load_terms(path: Path) -> Terms:
    """Reads terms from a YAML or JSON file. Raises BadInput with the key that is wrong."""
    try:
        raw = load_yaml(path.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise BadInput(f"cannot be read as terms: {error}", where=path, todo="Give a YAML or JSON file") from None
    try:
        return Terms.model_validate(raw)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "(top)"
        raise BadInput(f"{key}: {first['msg']}", where=path, allowed="schema, parameters, effects") from None
