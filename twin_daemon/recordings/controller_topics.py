"""The joint that a controller's command topic drives, read from the topic's name."""

from __future__ import annotations

import re
from collections.abc import Iterable

_CONTROLLER = re.compile(r"^(?:sh_)?(?P<joint>.+?)_(?:mixed_)?position(?:_velocity)?_controller$")
_SHADOW = re.compile(r"^(?P<side>[rl]h_)?(?P<joint>(?:ff|mf|rf|lf|th|wr)j[0-5])$", re.IGNORECASE)


def joint_of_topic(topic: str, joints: Iterable[str]) -> str | None:
    """The command's name for a topic like /sh_rh_ffj3_position_controller/command (rh_FFJ3); None for other topics.

    A joint of the recording that differs only in upper and lower case gives the name; a J0 is in no recording.
    """
    parts = [part for part in topic.split("/") if part]
    if len(parts) < 2 or parts[-1] != "command":
        return None
    found = _CONTROLLER.match(parts[-2])
    if found is None:
        return None
    name = found["joint"]
    for joint in joints:
        if joint.lower() == name.lower():
            return joint
    shadow = _SHADOW.match(name)
    return (shadow["side"] or "").lower() + shadow["joint"].upper() if shadow else name
