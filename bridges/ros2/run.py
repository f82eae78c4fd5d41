"""The bridge's life: rclpy up, one thread that spins, everything down again."""

from __future__ import annotations

import logging
import time
from typing import NoReturn

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from bridges.ros2.node import TwinBridge
from twin_daemon.daemon.notify import Notifier
from twin_daemon.errors import BadInput, UsageError
from twin_daemon.services.stop import Stoppable

log = logging.getLogger("twin.bridge")
_TURN_S = 0.1  # how long a signal may wait to be noticed
_AFTER_ERROR_S = 0.02
_LAST_TURNS = 20


def run(given: dict[str, str], ros_args: list[str], stop: Stoppable, seconds: float | None = None) -> dict[str, int]:
    """Bridges until `stop` is set or `seconds` have passed; returns the counts.

    `given` are parameters by name, `ros_args` begins with --ros-args or is empty. Raises UsageError and BadInput.
    """
    try:
        rclpy.init(args=ros_args, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        _said_so(error, ros_args)
    try:
        try:
            node = TwinBridge(given)
        except (ParameterException, NameValidationException) as error:
            raise BadInput(str(error), todo="Correct the parameter or the remapping") from None
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        log.info(
            "the bridge of %s looks for the twin at %s; its node is %s",
            node.settings.description.namespace,
            node.settings.endpoint,
            node.get_fully_qualified_name(),
        )
        notifier = Notifier()
        notifier.say("READY=1")
        try:
            _spin(executor, node, stop, seconds, notifier)
        finally:
            notifier.say("STOPPING=1")
            _let_go(executor, node)
            node.close()
        return node.counts()
    finally:
        try_shutdown()


def _spin(
    executor: SingleThreadedExecutor, node: TwinBridge, stop: Stoppable, seconds: float | None, notifier: Notifier
) -> None:
    end_s = None if seconds is None else time.monotonic() + seconds
    while not stop.is_set() and (end_s is None or time.monotonic() < end_s):
        notifier.alive()
        try:
            executor.spin_once(timeout_sec=_TURN_S)
        except ExternalShutdownException:
            return
        except Exception as error:  # of rclpy itself: the callbacks are guarded
            node.guard.failed("a turn of the executor", error)
            stop.wait(_AFTER_ERROR_S)


def _let_go(executor: SingleThreadedExecutor, node: TwinBridge) -> None:
    """Ends services that still wait for the twin, so that nobody waits for them, and then the executor."""
    try:
        node.link.give_up()
        for _ in range(_LAST_TURNS):
            executor.spin_once(timeout_sec=0.0)
    except Exception as error:
        node.guard.failed("the last turns of the executor", error)
    executor.shutdown(timeout_sec=_TURN_S)  # without a limit it may wait for unfinished callbacks


def _said_so(error: RuntimeError, ros_args: list[str]) -> NoReturn:
    if ros_args:
        raise UsageError(f"ROS 2 refuses what stands after --ros-args: {error}", todo="Correct it") from None
    raise BadInput(
        f"ROS 2 does not start: {error}", todo="Check RMW_IMPLEMENTATION, ROS_DOMAIN_ID and the installation"
    ) from None
