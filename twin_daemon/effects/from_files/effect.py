"""A law from a file as an effect like any other: one parameter, how strong it is beside what was found."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from twin_daemon.effects.base import Effect, Measurement, Parameter, Place, ReadingCurve, Scale, Story
from twin_daemon.effects.from_files import native
from twin_daemon.effects.from_files.schema import EffectFile
from twin_daemon.errors import BadInput

_ACTS_ON = {"torque": "joint", "command": "actuator", "reading": "sensor"}


class _Found(Effect):
    """What all laws from files have in common; `content` is the file's."""

    content: ClassVar[EffectFile]
    rank = 2000
    parameters = (Parameter("strength", "1", -3.0, 3.0, 0.0, 1.0, "times what was found"),)

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        if not native.exists(self.content):
            raise BadInput(f"'{self.key}' cannot be in a twin: {self.leaves_out}", todo="It stays a proposal")
        if self.content.port != "reading":
            native.write(spec, place, self.content, values["strength"])

    def measure(self, measurement: Measurement, place: Place, values: Mapping[str, float]) -> None:
        found, strength = self.content, values["strength"]
        if found.port == "reading" and strength:
            curve = ReadingCurve(found.neighbour, found.knots, tuple(strength * value for value in found.values))
            measurement.curves[place.target] = (*measurement.curves.get(place.target, ()), curve)

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        return ({"strength": 1.0}, {"strength": 0.3}) if native.exists(self.content) else ()


def effect_of(content: EffectFile) -> Effect:
    """The effect that a file describes."""
    told = content.formula or "a curve without a formula"
    costs = native.cost(content)
    story = Story(
        what=f"{content.title}: {told}. A law that recordings asked for, of the user's own.",
        shows=content.story or f"Found at {content.found_at}.",
        cause="Unknown: this is a proposal, not a cause.",
        remedy=f"Test it on other motion. As a model: {costs or 'the whole law is in it'}.",
        excitation=f"motion over {content.visited[0]:.3g} to {content.visited[1]:.3g} of what it depends on",
    )
    written = {
        "key": content.name,
        "title": content.title,
        "acts_on": _ACTS_ON[content.port],
        "story": story,
        "content": content,
        "leaves_out": costs,
    }
    return type("Found", (_Found,), written)()
