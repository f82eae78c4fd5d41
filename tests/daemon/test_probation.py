"""A version that does worse than it promised is told from one whose motion is merely harder."""

from __future__ import annotations

from twin_daemon.daemon.probation import Live, Probation


def watched(promised: float | None = 1e-5, before: float = 2e-5) -> Probation:
    made = Probation(60.0, 3.0)
    made.begin("v2", promised, Live(before, 1000), 0.0)
    return made


def test_three_bad_looks_in_a_row_fail_it_once() -> None:
    made = watched()
    assert made.failed(Live(1e-3, 400), 1.0) is None
    assert made.failed(Live(1e-5, 400), 2.0) is None
    assert [made.failed(Live(1e-3, 400), 3.0 + i) for i in range(2)] == [None, None]
    found = made.failed(Live(1e-3, 400), 5.0)
    assert found is not None
    assert found[0] == "v2"
    assert found[2] == 3.0 * 2e-5
    assert made.failed(Live(1e-3, 400), 6.0) is None


def test_a_hard_motion_is_hard_for_its_predecessor_too() -> None:
    made = watched(before=1e-3)
    assert all(made.failed(Live(2e-3, 400), float(i)) is None for i in range(10))


def test_few_samples_and_old_versions_say_nothing() -> None:
    made = watched()
    assert all(made.failed(Live(1.0, 100), float(i)) is None for i in range(10))
    assert all(made.failed(Live(1.0, 900), 61.0 + i) is None for i in range(10))


def test_without_anything_known_nothing_is_worse() -> None:
    made = Probation(60.0, 3.0)
    made.begin("v2", None, Live(0.0, 0), 0.0)
    assert all(made.failed(Live(1.0, 900), float(i)) is None for i in range(10))
