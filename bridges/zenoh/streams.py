"""Under which keys the daemon hears the hand. Its router's rules and its subscriptions are both made of them."""

from __future__ import annotations

import itertools

from bridges.zenoh.ros_keys import RosKeys
from twin_daemon.hand import HandDescription

HEARD = ("joint_states", "joint_commands")


def heard_keys(description: HandDescription) -> dict[str, str]:
    """The key of each stream that the hand and those who command it speak on."""
    return {name: description.key(name) for name in HEARD}


def subscriptions(keys: dict[str, str]) -> dict[str, dict[str, str]]:
    """Which key expressions to subscribe to for these streams, each with the streams that come by it, by their key.

    One subscription for all streams where their keys allow it: each has a thread of its own, and on a loaded machine
    two would let states overtake the commands that led to them.
    """
    streams = {key: stream for stream, key in keys.items()}
    shared = _covering(list(keys.values()))
    return {shared: streams} if shared is not None else {key: {key: stream} for key, stream in streams.items()}


def daemon_subscribes(description: HandDescription, ros: RosKeys | None) -> list[str]:
    """All key expressions that a daemon of this hand subscribes to for its streams."""
    sources = [heard_keys(description), *([ros.subscribed] if ros is not None else [])]
    return [expression for keys in sources for expression in subscriptions(keys)]


def _covering(keys: list[str]) -> str | None:
    """A key expression for keys that differ in the end of their last part alone; None where they do not."""
    parents = {key.rpartition("/")[0] for key in keys}
    if len(parents) != 1 or any("*" in key for key in keys):
        return None
    letters = zip(*(key.rpartition("/")[2] for key in keys), strict=False)
    start = "".join(same[0] for same in itertools.takewhile(lambda column: len(set(column)) == 1, letters))
    return "/".join(filter(None, [parents.pop(), f"{start}$*" if start else "*"]))
