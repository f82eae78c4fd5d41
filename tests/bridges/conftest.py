"""A ROS 2 network for tests, and the processes of the twin in it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.bridges.ros_network import Peer
from tests.processes.conftest import Twin


@pytest.fixture(scope="module")
def ros(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A ROS 2 network of its own for the processes of this file."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(2 + os.getpid() % 90))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        patch.setenv("ROS_LOG_DIR", str(tmp_path_factory.mktemp("ros-log")))
        patch.delenv("RMW_IMPLEMENTATION", raising=False)
        yield


@pytest.fixture(scope="module")
def peers(ros: None) -> Iterator[tuple[Peer, Peer]]:
    """Two ROS nodes: the hand's driver and the operator."""
    driver, operator = Peer("-r", "__node:=driver"), Peer("-r", "__node:=operator")
    try:
        yield driver.ready(), operator.ready()
    finally:
        driver.close()
        operator.close()


@pytest.fixture
def twin(ros: None, tmp_path: Path) -> Iterator[Twin]:
    with Twin(tmp_path) as processes:
        yield processes
