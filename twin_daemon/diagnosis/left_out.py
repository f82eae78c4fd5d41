"""What was not looked at as something is touched, or only after all else, and what an answer says of that."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from twin_daemon.diagnosis.thresholds import FAR_BEYOND_OTHERS, MUCH_TOUCHED
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.estimation.thresholds import CONTACT_MARGIN_M
from twin_daemon.simulation.alignment import not_answering


@dataclass
class LeftOut:
    """Groups that touch something nearly all the time, with their joints; the share of motion that was left out of
    others by group; and groups at which only motion near something else showed an error.

    Joints that are `unanswering` stand still although they are told to move.
    """

    touching: dict[str, tuple[str, ...]] = field(default_factory=dict)
    shares: Mapping[str, float] = field(default_factory=dict)
    near: Sequence[str] = ()
    unanswering: Sequence[str] = ()

    def cut(self, reduction: Reduction, groups: Sequence[Reduced]) -> None:
        """Notes how much of the motion of groups a reduction leaves out."""
        self.shares = {group.name: reduction.share_touching(group.joints) for group in groups}

    def of(self, joints: Collection[str], groups: Collection[str]) -> LeftOut:
        """What of it is about some joints, which are those of so named groups."""
        return LeftOut(
            {name: own for name, own in self.touching.items() if not set(own).isdisjoint(joints)},
            {name: share for name, share in self.shares.items() if name in groups},
            [name for name in self.near if name in groups],
            [name for name in self.unanswering if name in joints],
        )

    def far_off(self, rms_rad: Mapping[str, float], judged: Collection[str]) -> dict[str, float]:
        """{joint: rms error (rad)} of what touches something, where it is far beyond that of all that was judged."""
        touching = {joint for joints in self.touching.values() for joint in joints}
        bar = FAR_BEYOND_OTHERS * max((rms for joint, rms in rms_rad.items() if joint in judged), default=0.0)
        return {joint: rms for joint, rms in rms_rad.items() if joint in touching and rms > bar}

    def notes(self) -> tuple[str, ...]:
        """What an answer says of it, for people."""
        notes = [f"{name} was left out: it touches something nearly all the time" for name in self.touching]
        much = [f"{name} ({share:.0%})" for name, share in self.shares.items() if share > MUCH_TOUCHED]
        if much:
            notes.append(f"left out of the motion, as something is touched: {', '.join(much)}")
        if self.near:
            notes.append(
                f"{', '.join(self.near)}: seen only while less than {1e3 * CONTACT_MARGIN_M:.0f} mm from another part, "
                "by the model's shapes; a touch that they do not show would look like it"
            )
        if self.unanswering:
            notes.append(not_answering(self.unanswering))
        return tuple(notes)
