"""Nothing unchecked gets near the model, and everything refused is counted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from twin_daemon.daemon.intake import Intake
from twin_daemon.daemon.messages import JointSample
from twin_daemon.daemon.stamps import StampOrder

JOINTS = ("rh_FFJ1", "rh_FFJ2", "rh_FFJ3")


def intake() -> Intake:
    return Intake(JOINTS, np.zeros(3), np.full(3, 1.57))


def sample(stamp_ns: int, names: tuple[str, ...] = JOINTS, position: list[float] | None = None) -> JointSample:
    return JointSample(stamp_ns, names, np.array([0.1] * len(names) if position is None else position))


def test_a_message_in_another_order_and_without_prefix_is_matched_by_name() -> None:
    accepted = intake().accept(sample(1, ("FFJ3", "rh_FFJ1"), [0.3, 0.1]), 0)
    assert accepted is not None
    assert dict(zip(accepted.index.tolist(), accepted.position.tolist(), strict=True)) == {2: 0.3, 0: 0.1}


def test_a_value_that_cannot_be_right_costs_only_its_own_joint() -> None:
    gate = intake()
    accepted = gate.accept(sample(1, position=[0.1, np.nan, 40.0]), 0)
    assert accepted is not None
    assert accepted.index.tolist() == [0]
    assert gate.counts == {"not_finite": 1, "out_of_range": 1}


def test_what_contradicts_itself_is_refused_and_counted_by_kind() -> None:
    gate = intake()
    bad = [
        ("length_mismatch", sample(1, position=[0.1])),
        ("length_mismatch", JointSample(1, JOINTS, np.zeros(3), velocity=np.zeros(2))),
        ("duplicate_names", sample(1, ("rh_FFJ1", "FFJ1"))),
        ("unknown_names", sample(1, ("gripper",))),
        ("empty", sample(1, ())),
        ("malformed", sample(-5)),
        ("not_finite", sample(1, position=[np.inf] * 3)),
    ]
    for kind, message in bad:
        before = gate.counts[kind]
        assert gate.accept(message, 0) is None
        assert gate.counts[kind] == before + 1
    assert gate.accepted == 0
    assert gate.received == len(bad)
    assert gate.unknown_names == {"gripper"}
    assert gate.accept(sample(1), 0) is not None, "a refused message must not use up its stamp"


def test_an_empty_stamp_is_replaced_by_the_arrival() -> None:
    gate = intake()
    accepted = gate.accept(sample(0), 77)
    assert accepted is not None
    assert accepted.stamp_ns == 77
    assert gate.counts["no_stamp"] == 1


def test_many_invented_names_do_not_fill_the_memory() -> None:
    gate = intake()
    for i in range(500):
        gate.accept(sample(i + 1, (f"joint_{i}",)), 0)
    assert len(gate.unknown_names) <= 32
    assert gate.counts["unknown_names"] == 500


def test_overtaken_and_repeated_messages_are_refused() -> None:
    order = StampOrder()
    assert [order.judge(s) for s in (10, 20, 20, 15, 30)] == ["ok", "ok", "duplicate_stamp", "backwards_stamp", "ok"]


def test_a_stream_that_starts_again_earlier_is_believed_after_it_proved_itself() -> None:
    order = StampOrder(proof=10)
    order.judge(10_000)
    verdicts = [order.judge(s) for s in range(1, 15)]
    assert verdicts == ["backwards_stamp"] * 9 + ["restarted"] + ["ok"] * 4


def test_two_sources_that_alternate_never_restart_each_other() -> None:
    order = StampOrder()
    verdicts = [order.judge(s) for i in range(100) for s in (10_000 + i, i)]
    assert "restarted" not in verdicts


@given(st.lists(st.integers(min_value=0, max_value=50), max_size=200))
def test_accepted_stamps_increase_except_at_a_restart(stamps: list[int]) -> None:
    order, last = StampOrder(proof=3), -1
    for stamp in stamps:
        verdict = order.judge(stamp)
        if verdict == "ok":
            assert stamp > last
        if verdict in ("ok", "restarted"):
            last = stamp


def said(gate: Intake, source: str, stamp_ns: int, now_s: float) -> tuple[bool, list[str]]:
    """Whether a message was believed, and what was doubted about it."""
    accepted = gate.accept(replace(sample(stamp_ns), source=source), 0, now_s)
    return accepted is not None, [doubt.kind for doubt in gate.take_doubts()]


def test_of_two_sources_at_once_the_first_is_believed_and_the_second_named() -> None:
    gate = intake()
    assert said(gate, "driver", 1000, 0.0) == (True, [])
    assert said(gate, "ahead", 300_000_000, 0.01) == (False, ["second_source"])
    assert said(gate, "", 300_000_001, 0.02) == (False, ["second_source"])
    assert said(gate, "driver", 2000, 0.03) == (True, [])
    # a message about other joints is no rival
    assert gate.accept(replace(sample(9, ("gripper",)), source="arm"), 0, 0.04) is None
    assert gate.take_doubts() == []
    assert said(gate, "ahead", 400_000_000, 1.2) == (True, ["source_changed"])
    assert gate.counts["second_source"] == 2


def test_one_overtaken_message_is_told_and_stamps_that_go_back_and_forth_are_serious() -> None:
    gate = intake()
    stamps = [10, 20, 15, 30, 25, 40, 35]
    serious = []
    for number, stamp_ns in enumerate(stamps):
        gate.accept(replace(sample(stamp_ns), source="driver"), 0, 0.1 * number)
        serious += [(doubt.serious, round(doubt.back_s * 1e9)) for doubt in gate.take_doubts()]
    assert serious == [(False, 5), (False, 5), (True, 5)]
