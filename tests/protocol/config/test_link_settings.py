"""Where a service may listen and connect: in plain on this machine, else as somebody says."""

from __future__ import annotations

import pytest

from hoap3.protocol.config.endpoints import beyond_this_machine
from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.config import ControllerLink
from hoap3.robot_emulator.config import EmulatorLink

OURS = ("tcp/127.0.0.1:1", "tcp/127.9.9.9:1", "tcp/[::1]:1", "tcp/localhost:1", "udp/127.0.0.1:1")
THEIRS = ("tcp/0.0.0.0:1", "tcp/[::]:1", "tls/192.168.1.10:1", "ws/robot.example:1", "tcp/::1")


@pytest.mark.parametrize(
    ("endpoint", "beyond"), [*((each, False) for each in OURS), *((each, True) for each in THEIRS)]
)
def test_what_other_machines_reach_is_known(endpoint, beyond):
    assert beyond_this_machine(endpoint) is beyond


@pytest.mark.parametrize(
    "link",
    [
        {"listen": ["tcp/0.0.0.0:7447"]},
        {"listen": ["tcp/127.0.0.1:7447", "tcp/10.0.0.9:7447"]},
        {"kind": "hoap3_tcp", "hoap3_tcp": {"host": "0.0.0.0"}},
    ],
)
def test_a_robot_listens_elsewhere_only_where_somebody_says_so(link):
    with pytest.raises(ConfigError, match="--insecure"):
        parse(EmulatorLink, link, "robot.yaml")
    assert parse(EmulatorLink, {**link, "insecure": True}, "robot.yaml").reachable


def test_a_controller_reaches_out_without_a_word():
    parse(ControllerLink, {"connect": ["tcp/10.0.0.9:7447"]}, "law.yaml")
    parse(ControllerLink, {"kind": "hoap3_tcp", "hoap3_tcp": {"host": "10.0.0.9"}}, "law.yaml")


@pytest.mark.parametrize("model", [EmulatorLink, ControllerLink])
def test_with_certificates_the_default_place_is_over_tls(model):
    key = "listen" if model is EmulatorLink else "connect"
    for written in ({}, {key: ["tcp/127.0.0.1:7447"]}):
        link = parse(model, {"secure": "certs/me", **written}, "x.yaml")
        assert getattr(link, key) == ("tls/127.0.0.1:7447",)


@pytest.mark.parametrize(
    ("link", "said"),
    [
        ({"secure": "c", "listen": ["tcp/127.0.0.1:7500"]}, "tls/127.0.0.1:7500"),
        (
            {"secure": "c", "listen": ["tls/10.0.0.9:7500", "tcp/10.0.0.9:7501"]},
            "tcp/10.0.0.9:7501",
        ),
        ({"secure": "c", "kind": "hoap3_tcp"}, "hoap3_tcp"),
        ({"listen": ["tls/127.0.0.1:7500"]}, "--secure"),
    ],
)
def test_plain_and_certificates_do_not_mix(link, said):
    with pytest.raises(ConfigError, match=said):
        parse(EmulatorLink, link, "x.yaml")


@pytest.mark.parametrize("places", [7447, None, "tls/127.0.0.1:7447"])
def test_endpoints_that_are_no_list_are_refused_with_a_certificate_too(places):
    with pytest.raises(ConfigError, match="connect"):
        parse(ControllerLink, {"secure": "certs/qp", "connect": places}, "here")
