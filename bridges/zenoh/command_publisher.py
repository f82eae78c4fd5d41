"""The way out to the hand. It takes what has passed the gate, and nothing else."""

from __future__ import annotations

import zenoh

from bridges.zenoh.sources import Speaker
from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample
from twin_daemon.gate.sendable import Sendable
from twin_daemon.hand import HandDescription


class CommandPublisher:
    """Publishes commands as joint states on the hand's own key, and on the key from which other bridges take them."""

    def __init__(self, session: zenoh.Session, description: HandDescription) -> None:
        self._publishers = [
            Speaker(
                session.declare_publisher(
                    key,
                    encoding="application/cdr",
                    congestion_control=zenoh.CongestionControl.DROP,
                    priority=zenoh.Priority.INTERACTIVE_HIGH,
                    express=True,
                )
            )
            for key in (description.key("joint_commands"), description.key("command", verb="sent"))
        ]

    @property
    def source(self) -> str:
        """Who it is on the hand's own key: by this it is told from others that send there."""
        return self._publishers[0].source

    def send(self, command: Sendable) -> None:
        """Sends one command. Raises TypeError for anything that has not passed the gate."""
        if type(command) is not Sendable:
            raise TypeError(f"{type(command).__name__} has not passed the gate")
        payload = cdr.encode(JointSample(command.stamp_ns, command.names, command.position))
        for publisher in self._publishers:
            publisher.put(payload)

    def close(self) -> None:
        for publisher in self._publishers:
            publisher.undeclare()
