"""Files, names and values that a first user gets wrong: each error says what to write instead."""

from __future__ import annotations

from typing import Any

import pytest

from hoap3.protocol.config.settings import LinkSettings, apply_overrides, parse, parse_yaml
from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.config import ControllerConfig, check_parameters
from hoap3.remote_controller.registry import find
from hoap3.remote_controller.tasks.posture import PostureTask
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.robots import load
from hoap3.robot_emulator.service import describe

UR5 = load("ur5")
BENT = (0.0, -1.0, 1.0, 0.2, 0.0, 0.0)

YAML = {
    "a tab": (b"a:\n\tb: 1\n", "line 2"),
    "a tab later": (b"a:\tx\n\tb: 1\n", "line 2"),
    "no space": (b"a: 1\nb:2\nc: 3\n", "line 3"),
    "two colons": (b"a: b: c\n", "line 1"),
    "an open list": (b"a: [1, 2\n", "line 2"),
    "an at sign": (b"a: @b\n", "line 1"),
    "an open quote": (b"a: 'b\n", "line 2"),
    "Latin-1": (b"a: \xff\n", "byte 3"),
    "UTF-16": (b"\xff\xfe" + "a: 1".encode("utf-16-le"), "byte 0"),
}


@pytest.mark.parametrize("name", YAML)
def test_a_yaml_error_has_its_place_and_a_remedy(name: str) -> None:
    data, place = YAML[name]
    with pytest.raises(ConfigError) as caught:
        parse_yaml(data, "my.yaml")
    error = caught.value
    assert (error.file, error.key) == ("my.yaml", "")
    assert place in error.problem
    assert error.remedy


@pytest.mark.parametrize(
    ("objective", "known"),
    [
        ({"kind": "lp", "gamma": 1}, "kind, p, weights"),
        ({"kind": "qp12", "p": 2}, "adaptive_gamma"),
    ],
)
def test_unknown_keys_are_compared_with_those_of_the_kind(objective: Any, known: str) -> None:
    settings = {"controller": "stable_qp", "parameters": {"objective": objective}}
    with pytest.raises(ConfigError) as caught:
        check_parameters(parse(ControllerConfig, settings, "my.yaml"), "my.yaml")
    assert known in str(caught.value)


@pytest.mark.parametrize(
    ("key", "better"), [("tasks[0]", "tasks.0"), ("p.tasks[1].kp", "p.tasks.1.kp")]
)
def test_brackets_in_a_key_are_refused_with_the_right_key(key: str, better: str) -> None:
    with pytest.raises(ConfigError) as caught:
        apply_overrides({"p": {"tasks": [{}, {}]}}, [f"{key}=1"])
    assert caught.value.key == key
    assert better in caught.value.remedy


def test_a_key_that_has_brackets_stays_a_key() -> None:
    assert apply_overrides({"a[0]": 1}, ["a[0]=2"]) == {"a[0]": 2}


def test_a_name_that_is_not_utf8_is_refused() -> None:
    with pytest.raises(ConfigError) as caught:
        parse(EmulatorConfig, {"robot": "/tmp/f\udcff/arm.urdf"}, "my.yaml")
    assert caught.value.key == "robot"
    assert "UTF-8" in caught.value.problem


def test_a_start_posture_is_given_as_joint_values() -> None:
    robot = describe(EmulatorConfig(robot="ur5", posture=BENT))
    assert robot.initial_position.tolist() == list(BENT)
    assert robot.postures.keys() > UR5.postures.keys()  # none of its own was replaced
    assert all(robot.postures[name] == values for name, values in UR5.postures.items())


@pytest.mark.parametrize("posture", [(), (0.0, 1.0), (*BENT[:5], 99.0)])
def test_joint_values_that_do_not_fit_are_refused(posture: tuple[float, ...]) -> None:
    with pytest.raises(ConfigError) as caught:
        describe(EmulatorConfig(robot="ur5", posture=posture), "my.yaml")
    assert (caught.value.file, caught.value.key) == ("my.yaml", "posture")
    assert "wrist_3_joint" in caught.value.remedy


def test_an_unknown_posture_is_answered_with_those_there_are() -> None:
    with pytest.raises(ConfigError) as caught:
        describe(EmulatorConfig(robot="ur5", posture="bent"), "my.yaml")
    assert all(name in caught.value.remedy for name in UR5.postures)


@pytest.mark.parametrize(
    ("model", "key"),
    [
        (find("joint_acceleration").Parameters, "posture_rad"),
        (PostureTask.Parameters, "target_rad"),
    ],
)
def test_a_posture_of_a_controller_is_given_as_joint_values(model: Any, key: str) -> None:
    found = parse(model, {"posture": list(BENT)}, "my.yaml")
    assert getattr(found, key) == BENT
    assert found.posture is None
    with pytest.raises(ConfigError) as caught:
        parse(model, {"posture": [0.0, "a"]}, "my.yaml")
    assert caught.value.key == "posture"


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ("tcp/[fe80::1%eth0]:7447", "tcp/[fe80::1]:7447#iface=eth0"),
        ("tcp/[fe80::1]:7447#iface=eth0", "tcp/[fe80::1]:7447#iface=eth0"),
        ("udp/[FEBF::2%2]:80", "udp/[FEBF::2]:80#iface=2"),
        ("tcp/[fec0::1]:7447", "tcp/[fec0::1]:7447"),
        ("tcp/fe80host:7447", "tcp/fe80host:7447"),
        ("tcp/host-fe90:7447", "tcp/host-fe90:7447"),
        ("tcp/feb1:7447", "tcp/feb1:7447"),
    ],
)
def test_a_link_local_address_names_its_interface(given: str, meant: str) -> None:
    assert parse(LinkSettings, {"connect": [given]}, "my.yaml").connect == (meant,)


@pytest.mark.parametrize("given", ["tcp/[fe80::1]:7447", "tcp/[FE9f::a:1]:1"])
def test_a_link_local_address_without_interface_is_refused(given: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse(LinkSettings, {"connect": [given]}, "my.yaml")
    assert caught.value.key == "connect.0"
    assert "%eth0" in caught.value.remedy
