"""The layouts for other viewers name what a recording of `twin record` has."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

from bridges.foxglove.bridge import EVENTS, VERSION
from twin_daemon.hand import load_hand
from twin_daemon.services.recorder import TOPICS

LAYOUTS = Path(__file__).resolve().parents[2] / "docs" / "layouts"


def leaves(node: Any) -> list[str]:
    return [node] if isinstance(node, str) else [leaf for side in ("first", "second") for leaf in leaves(node[side])]


def test_the_layout_for_foxglove_shows_the_streams_of_a_recording() -> None:
    layout = json.loads((LAYOUTS / "foxglove.json").read_text())
    panels, variables = layout["configById"], set(layout["globalVariables"])
    assert sorted(leaves(layout["layout"])) == sorted(panels)
    paths = [path["value"] for panel in panels.values() for path in panel.get("paths", [])]
    paths += [panel["topicPath"] for panel in panels.values() if "topicPath" in panel]
    drawn = {re.match(r"(/[\w/]+)(\.\w+(\[.*\])?)?$", path)[1] for path in paths}  # pyright: ignore[reportOptionalSubscript]
    assert drawn == {*("/" + topic for topic in TOPICS.values()), VERSION}
    assert {name for path in paths for name in re.findall(r"\$(\w+)", path)} == variables
    assert {panel["topicToRender"] for panel in panels.values() if "topicToRender" in panel} == {EVENTS}
    most = {p["globalVariableName"]: p["sliderProps"]["max"] for p in panels.values() if "sliderProps" in p}
    hand = load_hand().description
    assert most == {"joint": len(hand.joints) - 1, "command": len(hand.commands) - 1}


def test_the_layout_for_plotjuggler_has_every_joint_of_the_hand() -> None:
    root = ElementTree.parse(LAYOUTS / "plotjuggler-shadow-hand.xml").getroot()
    assert root.tag == "root"
    hand = load_hand().description
    names = [curve.attrib["name"] for curve in root.iter("curve")]
    found: dict[str, set[str]] = {}
    for name in names:
        topic, _, joint = name.removesuffix("/position").rpartition("/")
        found.setdefault(topic.removeprefix("/"), set()).add(joint)
    assert set(found) == set(TOPICS.values())
    for topic in ("joint_states", "twin/joint_states", "twin/residual"):
        assert found[topic] == set(hand.joints), topic
    assert found["joint_commands"] <= set(hand.commands)
    for splitter in root.iter("DockSplitter"):
        sizes = splitter.attrib["sizes"].split(";")
        assert int(splitter.attrib["count"]) == len(sizes) == len(list(splitter))
