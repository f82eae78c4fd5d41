"""A bridge's own messages on command topics against copies of them."""

from __future__ import annotations

import time

from bridges.ros2.own_messages import OwnMessages


def published(own: OwnMessages, content: float, topic: str = "/a") -> int:
    """Publishes, and says when it was written."""
    with own.publishing(topic, content):
        return time.time_ns()


def test_each_message_is_its_own_once() -> None:
    own = OwnMessages()
    written_ns = [published(own, 0.5), published(own, 0.5)]
    assert [own.take("/a", 0.5, at) for at in written_ns] == [True, True]
    assert not own.take("/a", 0.5, written_ns[1])


def test_a_copy_is_known_by_when_it_was_written_also_if_it_comes_first() -> None:
    own = OwnMessages()
    written_ns = published(own, 0.5)
    assert not own.take("/a", 0.5, written_ns + 1_000_000)
    assert not own.take("/a", 0.5, written_ns - 1_000_000)
    assert own.take("/a", 0.5, written_ns)


def test_another_value_or_topic_is_not_its_own() -> None:
    own = OwnMessages()
    written_ns = published(own, 0.5)
    assert not own.take("/a", 0.6, written_ns)
    assert not own.take("/b", 0.5, written_ns)


def test_without_times_the_number_of_messages_tells() -> None:
    own = OwnMessages()
    published(own, 0.5)
    assert own.take("/a", 0.5, None)
    assert not own.take("/a", 0.5, 0)


def test_a_message_may_be_heard_before_publishing_it_has_returned() -> None:
    own = OwnMessages()
    with own.publishing("/a", 0.5):
        assert own.take("/a", 0.5, time.time_ns())


def test_what_never_came_back_does_not_hide_what_does() -> None:
    own = OwnMessages()
    for number in range(100):
        published(own, float(number))
    written_ns = published(own, 7.5)
    assert own.take("/a", 7.5, written_ns)
    assert not own.take("/a", 7.5, None)
