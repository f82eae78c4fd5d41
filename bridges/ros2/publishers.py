"""Who publishes on a topic beside this node, as far as the ROS graph knows."""

from __future__ import annotations

from collections import Counter

from rclpy.node import Node


def others_on(node: Node, topic: str) -> str:
    """The nodes that publish on the topic (its full name) beside this one, in words. A message does not say which of
    them it is from."""
    found = Counter(
        f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in node.get_publishers_info_by_topic(topic)
    )
    # taken off by number: another node may have the same name
    found[node.get_fully_qualified_name()] -= sum(own.topic_name == topic for own in node.publishers)
    names = sorted(+found)
    if not names:
        return f"a ROS 2 node on {topic} that has gone"
    if len(names) == 1:
        return f"the ROS 2 node {names[0]} on {topic}"
    return f"one of the ROS 2 nodes {', '.join(names)} on {topic}"
