"""Each topic and field that a layout names is in a log, and in what a running robot shows."""

from __future__ import annotations

import json
import math
import re
from collections import defaultdict
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from foxglove_client import FoxgloveClient
from looked_at import LookedAt, fed
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from support.command_bench import endpoint, inside
from support.log_samples import describe, inputs, ticks, write

from hoap3.protocol.messages import Event
from hoap3.robot_emulator.robots import load
from hoap3.tools.bridge.foxglove_server import DESCRIPTION_TOPIC, FoxgloveServer
from hoap3.tools.bridge.layouts import foxglove_layout, plotjuggler_layout

ROBOT = describe(5)
Messages = dict[str, Any]
"""One decoded message of each topic."""


@pytest.fixture(scope="module")
def logged(tmp_path_factory: pytest.TempPathFactory) -> Messages:
    folder = tmp_path_factory.mktemp("log")
    path = write(folder, inputs(ROBOT) + ticks(5, 200)).paths[0]
    found: Messages = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for decoded in reader.iter_decoded_messages():
            found[decoded.channel.topic] = decoded.decoded_message
    return found


@pytest.fixture(scope="module")
def live() -> Iterator[Messages]:
    at = endpoint()
    with (
        closing(FoxgloveServer("127.0.0.1", 0)) as server,
        LookedAt(ROBOT, at) as robot,
        fed(server, lambda: (ROBOT.name, at)),
        FoxgloveClient(server.port) as client,
    ):
        client.look_at_all()

        def say() -> None:
            for message in (robot.state(), robot.setpoint(), Event()):
                robot.say(message)

        client.wait_for(lambda: len(client.messages) == 6, say)
        yield {topic: client.decoded_newest(topic) for topic in client.channels}


def panels(layout: dict[str, Any]) -> list[str]:
    """Panels that stand somewhere in a layout of Foxglove."""

    def below(part: Any) -> list[str]:
        return [part] if isinstance(part, str) else below(part["first"]) + below(part["second"])

    return below(layout["layout"])


def foxglove_paths(layout: dict[str, Any]) -> list[str]:
    """Message paths (https://docs.foxglove.dev/docs/visualization/message-path-syntax)."""
    found = []
    for panel in layout["configById"].values():
        found += [path["value"] for path in panel.get("paths", ())]
        found += [panel["topicPath"]] if "topicPath" in panel else []
    return found


def shown(message: Any, fields: str) -> Any:
    """What `.a.b[2]` is of a message."""
    for name, place in re.findall(r"\.(\w+)(?:\[(\d+)\])?", fields):
        message = getattr(message, name)
        message = message[int(place)] if place else message
    return message


def test_foxglove_finds_every_topic_and_field_and_has_a_place_for_every_panel(logged, live):
    layout = json.loads(foxglove_layout(ROBOT))
    paths = foxglove_paths(layout)
    assert len(paths) > 2 * ROBOT.n
    for messages in (logged, live):
        for path in paths:
            topic, dot, fields = path.partition(".")
            value = shown(messages[topic], dot + fields)
            assert not fields or math.isfinite(value), path
    layers = layout["configById"]["3D!robot"]["layers"].values()
    (model,) = [each["topic"] for each in layers if each["layerId"] == "foxglove.Urdf"]
    assert model == DESCRIPTION_TOPIC
    assert live[model].data == ROBOT.urdf
    assert sorted(panels(layout)) == sorted(layout["configById"])


def test_plotjuggler_finds_every_curve(logged, live):
    """It names the number of a field `topic/field[place]`, and a joint `topic/joint/position`."""
    tree = ET.fromstring(plotjuggler_layout(ROBOT))
    curves = [each.attrib["name"] for each in tree.iter("curve")]
    assert len(curves) > 3 * ROBOT.n
    for messages in (logged, live):
        for curve in curves:
            (topic,) = [each for each in messages if curve.startswith(f"{each}/")]
            rest = curve.removeprefix(f"{topic}/")
            if topic.endswith("/joint_states"):
                joint, _, field = rest.partition("/")
                value = getattr(messages[topic], field)[messages[topic].name.index(joint)]
            else:
                value = shown(messages[topic], f".{rest.replace('/', '.')}")
            assert math.isfinite(value), curve


def test_each_joint_has_its_own_curves() -> None:
    labels = defaultdict(list)
    for panel in json.loads(foxglove_layout(ROBOT))["configById"].values():
        for path in panel.get("paths", ()):
            labels[path["label"]].append(path["value"])
    for number, name in enumerate(ROBOT.joint_names):
        here = f"/robots/{ROBOT.name}/state"
        assert labels[name] == [f"{here}.q[{number}]", f"{here}.dq[{number}]"]


def test_the_command_writes_both_for_a_robot_and_replaces_none(tmp_path: Path) -> None:
    folder = tmp_path / "new"
    done = inside("bridge", "layouts", "--robot", "ur5", "--out", folder, "--json")
    assert done.code == 0, done.stderr
    written = [Path(path) for path in done.json()["layouts"]]
    assert sorted(folder.iterdir()) == sorted(written)
    texts = [path.read_text(encoding="utf-8") for path in written]
    assert texts == [foxglove_layout(load("ur5")), plotjuggler_layout(load("ur5"))]
    assert inside("bridge", "layouts", "--robot", "ur5", "--out", folder).code == 2
    assert inside("bridge", "layouts", "--out", folder).code == 0
    assert inside("bridge", "layouts", "--robot", "nobody", "--out", folder).code == 2
