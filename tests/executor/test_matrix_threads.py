"""The cores belong to our own threads: a matrix library that has as many beside them only waits."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

_ASKED = """
import json, twin_daemon.cli.app, numpy, scipy.linalg
from threadpoolctl import threadpool_info
print(json.dumps([one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"]))
"""


@pytest.mark.parametrize(("asked", "expected"), [(None, 1), ("2", 2)])
def test_the_matrix_library_has_one_thread_unless_the_user_says_otherwise(asked: str | None, expected: int) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    environment |= {"OPENBLAS_NUM_THREADS": asked} if asked else {}
    told = subprocess.run([sys.executable, "-c", _ASKED], env=environment, capture_output=True, text=True, check=True)
    counts = json.loads(told.stdout)
    assert counts
    assert max(counts) == min(expected, len(os.sched_getaffinity(0)))
