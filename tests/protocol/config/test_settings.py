"""Each kind of wrong setting is one error that names file, key, value and remedy."""

from __future__ import annotations

import datetime
import os
from pathlib import Path
from typing import Any, Literal

import pytest
import yaml
from pydantic import Field, ValidationError, field_validator

from hoap3.protocol.config import yaml_text
from hoap3.protocol.config.settings import (
    MAX_CONFIG_BYTES,
    LinkSettings,
    LogSettings,
    RealtimeSettings,
    RobotName,
    Settings,
    apply_overrides,
    load_yaml,
    parse,
    parse_yaml,
)
from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.config import ControllerConfig, check_parameters


class Gains(Settings):
    """Something nested."""

    rate: float = Field(1.0, gt=0)
    kind: Literal["a", "b"] = "a"


class Limits(Settings):
    """Another member of a union."""

    upper: float


class Stage(Settings):
    """An entry of a list."""

    beta_per_s: float = 1.0
    delta: float = 1.0


LINK_KEYS = "connect, hoap3_tcp, insecure, kind, lease_ms, listen, mode, secure"


class Service(Settings):
    """One of everything."""

    robot: RobotName
    gains: Gains | None = None
    either: Gains | Limits = Gains()
    table: dict[str, float] = Field(default_factory=dict)
    stages: tuple[Stage, ...] = Field((Stage(),), min_length=1)
    axes: tuple[str, ...] = Field(("x", "y"), min_length=2)
    even: int = 0
    link: LinkSettings = LinkSettings()
    realtime: RealtimeSettings = RealtimeSettings()
    log: LogSettings = LogSettings()

    @field_validator("even")
    @classmethod
    def _must_be_even(cls, value: int) -> int:
        if value % 2:
            raise ValueError("Odd numbers are not taken")
        return value


def refused(content: dict[str, Any], **more: str) -> ConfigError:
    """The error over some content."""
    with pytest.raises(ConfigError) as caught:
        parse(Service, {"robot": "arm", **content}, "robot.yaml", **more)
    error = caught.value
    assert str(error).startswith(f"robot.yaml: {error.key}: ")
    assert error.remedy in str(error)
    return error


@pytest.mark.parametrize(
    ("key", "found", "remedy"),
    [
        ("listen", "127.0.0.1:17447", "tcp/127.0.0.1:17447"),
        ("connect", "tcp://10.0.0.2:7447", "tcp/10.0.0.2:7447"),
        ("listen", "somewhere", "tcp/127.0.0.1:7447"),
        ("listen", "tcp/127.0.0.1:99999", "65535"),
        ("connect", "tcp/[::1]:65536", "65535"),
        ("connect", "udp/host:70000#iface=eth0", "65535"),
        *(("connect", each, "") for each in ("tcp/", "/127.0.0.1:7447", "tcp/a b", "")),
    ],
)
def test_what_is_no_endpoint_is_told_with_its_key_and_what_to_write(key, found, remedy):
    error = refused({"link": {key: ["tcp/127.0.0.1:65535", found]}})
    assert (error.key, error.value) == (f"link.{key}.1", found)
    assert remedy in error.remedy


def test_a_name_in_the_place_of_settings_is_told_where_it_belongs():
    assert "gains: {kind: a}" in refused({"gains": "a"}).remedy
    for text in ("a\nb", "x" * 500, ""):
        assert "kind" not in refused({"gains": text}).remedy


def test_what_is_right_is_taken():
    content = {
        "robot": "arm_2",
        "gains": {"rate": 2},
        "either": {"upper": 1.0},
        "table": {"int": 1.0},
        "link": {"listen": ["tcp/127.0.0.1:1"], "lease_ms": 100},
        "realtime": {"cpu": 3},
    }
    service = parse(Service, content, "robot.yaml")
    assert service.gains == Gains(rate=2.0)
    assert service.either == Limits(upper=1.0)
    assert service.table == {"int": 1.0}
    assert service.link.listen == ("tcp/127.0.0.1:1",)
    assert service.realtime.cpu == 3
    assert service.log == LogSettings()


@pytest.mark.parametrize(
    ("content", "key", "value", "remedy"),
    [
        ({"robott": 1}, "robott", 1, "'robot'"),
        ({"link": {"lease": 5}}, "link.lease", 5, "'lease_ms'"),
        ({"gains": {"rat": 2}}, "gains.rat", 2, "'rate'"),
        ({"zzzzzz": 1}, "zzzzzz", 1, "axes, either, even, gains, link, log, realtime"),
        ({"stages": [{"bta": 1}]}, "stages.0.bta", 1, "'beta_per_s'"),
        ({"stages": [{"dlta": 1}]}, "stages.0.dlta", 1, "'delta'"),
        ({"stages": [{"gain_per_s": 1}]}, "stages.0.gain_per_s", 1, "'beta_per_s'"),
        ({"stages": [{"zzz": 1}]}, "stages.0.zzz", 1, "beta_per_s, delta"),
        ({"either": {"zz": 1}}, "either.zz", 1, "kind, rate, upper"),
        ({"int": 1}, "int", 1, "axes, either"),
        ({"a[0]": 1}, "a[0]", 1, "axes, either"),
        ({"link": {"float": 1}}, "link.float", 1, LINK_KEYS),
        ({"link": {"nested(x)": 1}}, "link.nested(x)", 1, LINK_KEYS),
        ({"either": {"uper": 1.0}}, "either.uper", 1.0, "'upper'"),
    ],
)
def test_an_unknown_key_is_told_with_the_nearest_known_one(content, key, value, remedy):
    error = refused(content)
    assert (error.file, error.key, error.value) == ("robot.yaml", key, value)
    assert remedy in error.remedy


def test_every_wrong_place_is_told_once_each_in_a_line():
    content = {
        "gains": {"rat": 2, "kind": "c"},
        "either": {"upper": "x"},
        "realtime": {"cpu": True, "priority": 99},
        "link": {"lease": 5},
    }
    error = refused(content)
    keys = ["gains.kind", "gains.rat", "either.upper", "link.lease"]
    keys += ["realtime.priority", "realtime.cpu"]
    assert sorted([error.key, *(other.key for other in error.others)]) == sorted(keys)
    lines = str(error).splitlines()
    assert len(lines) == len(keys)
    assert all(line.startswith("robot.yaml: ") for line in lines)


def test_a_key_that_is_missing_beside_other_errors_is_told_but_no_misspelt_one():
    with pytest.raises(ConfigError) as caught:
        parse(Service, {"even": 3, "link": {"lease_ms": 1}}, "robot.yaml")
    assert {each.key for each in caught.value.others} == {"even", "link.lease_ms"}
    assert caught.value.key == "robot"
    with pytest.raises(ConfigError) as caught:
        parse(Service, {"robto": "arm", "even": 3}, "robot.yaml")
    assert [caught.value.key, *(each.key for each in caught.value.others)] == ["robto", "even"]


def test_a_file_that_is_wrong_everywhere_gets_a_short_answer():
    error = refused({f"wrong{number}": number for number in range(5000)})
    assert len(str(error).splitlines()) <= 10


@pytest.mark.parametrize(
    ("content", "key", "value"),
    [
        ({"robot": 5}, "robot", 5),
        ({"stages": []}, "stages", []),
        ({"axes": ["x"]}, "axes", ["x"]),
        ({"robot": "Arm"}, "robot", "Arm"),
        ({"gains": 3}, "gains", 3),
        ({"gains": {"rate": 0}}, "gains.rate", 0),
        ({"gains": {"rate": float("inf")}}, "gains.rate", float("inf")),
        ({"gains": {"kind": "c"}}, "gains.kind", "c"),
        ({"table": {"a[0]": "x"}}, "table.a[0]", "x"),
        ({"even": 3}, "even", 3),
        ({"link": {"listen": "tcp/a"}}, "link.listen", "tcp/a"),
        ({"link": {"listen": ["tcp/a", 1]}}, "link.listen.1", 1),
        ({"link": {"lease_ms": 99}}, "link.lease_ms", 99),
        ({"link": {"lease_ms": 60_001}}, "link.lease_ms", 60_001),
        ({"link": {1: 2}}, "link.1", 1),
        ({"realtime": {"policy": "fifo"}}, "realtime.policy", "fifo"),
        ({"realtime": {"priority": 99}}, "realtime.priority", 99),
        ({"realtime": {"cpu": True}}, "realtime.cpu", True),
        ({"realtime": {"cpu": -1}}, "realtime.cpu", -1),
        ({"realtime": {"cpu": "two"}}, "realtime.cpu", "two"),
        ({"log": {"cap_mb": 0}}, "log.cap_mb", 0),
    ],
)
def test_a_value_that_does_not_fit_is_told(content, key, value):
    error = refused(content)
    assert (error.file, error.key, error.value) == ("robot.yaml", key, value)
    assert repr(value) in str(error)


def test_a_missing_key_is_told():
    with pytest.raises(ConfigError) as caught:
        parse(Service, {}, "robot.yaml")
    assert (caught.value.file, caught.value.key) == ("robot.yaml", "robot")


def test_keys_are_told_from_the_top_of_the_file():
    assert refused({"even": "x"}, prefix="controller.parameters").key == (
        "controller.parameters.even"
    )


def test_a_long_value_is_cut_in_the_message_and_whole_in_the_error():
    error = refused({"even": "x" * 1000})
    assert error.value == "x" * 1000
    assert len(str(error)) < 300


def test_settings_cannot_be_changed():
    service = parse(Service, {"robot": "arm"}, "robot.yaml")
    with pytest.raises(ValidationError):
        service.link.lease_ms = 200


def test_by_default_nothing_listens_and_nothing_is_pinned_by_number():
    assert LinkSettings().listen == LinkSettings().connect == ()
    assert RealtimeSettings().cpu == "auto"


def written(folder: Path, content: bytes) -> Path:
    path = folder / "config.yaml"
    path.write_bytes(content)
    return path


def test_yaml_is_read(tmp_path):
    content = load_yaml(written(tmp_path, b"a: 1\nb: {c: [1, two]}  # comment\n"))
    assert content == {"a": 1, "b": {"c": [1, "two"]}}
    assert load_yaml(written(tmp_path, b"{}  # nothing yet\n")) == {}


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (b"a: {b", "line 2, column 1"),
        (b"a: 1\nb: 2\n c: 3", "line 3, column 3"),
        (b"\xff\xfe\x00", ""),
        (b"a: \xc3\x28", ""),
        (b"a: !!python/object/apply:os.getcwd []", "line 1, column 4"),
        (b"a: 2001-99-99", ""),
        (b"a: !!timestamp x", ""),
        (b"? [b]\n: 1", "line 1, column 3"),
        (b"a:\n  {b: 1}: 2", "line 2, column 3"),
        (b"%TAG !a! tag:a\n---\na: 1", ""),
        (b"--- {a: 1}\n--- {b: 1}", ""),
        (b"a: " + b"9" * 5000, "5000"),
        (b"a: " + b"[" * 600, "32"),
        (b"a: [" + b"1," * 60_000 + b"]", "20000"),
        (b"a: &x [1]\nb: *x", "line 2, column 4"),
        (b"a: &x [*x]", "line 1, column 8"),
        (b"- a\n- b", ""),
        (b"1: 2", ""),
        (b"", ""),
        (b" \n# nothing yet\n", ""),
        (b'<?xml version="1.0"?>\n<robot name="arm"/>\n', "URDF"),
        (b"\n<!-- ours -->\n<robot name='arm'>" + b" " * MAX_CONFIG_BYTES, "URDF"),
        (b"a: " + b"x" * MAX_CONFIG_BYTES, "1024 KiB"),
    ],
)
def test_a_file_that_cannot_be_used_is_named(tmp_path, content, named):
    path = written(tmp_path, content)
    with pytest.raises(ConfigError, match=rf"^{path}.*{named}") as caught:
        load_yaml(path)
    assert (caught.value.file, caught.value.key) == (str(path), "")
    assert caught.value.remedy


def test_a_file_of_just_a_mebibyte_is_read(tmp_path):
    line = b"# comment of a line".ljust(1023) + b"\n"
    content = b"a: 1".ljust(1023) + b"\n" + line * 1023
    assert len(content) == MAX_CONFIG_BYTES
    assert load_yaml(written(tmp_path, content)) == {"a": 1}


def test_what_is_no_file_is_not_opened(tmp_path):
    os.mkfifo(tmp_path / "fifo.yaml")
    places = (Path("/dev/zero"), "device"), (tmp_path / "fifo.yaml", "FIFO"), (tmp_path, "folder")
    for path, kind in (*places, (tmp_path / "none.yaml", "")):
        with pytest.raises(ConfigError, match=rf"{path}.*{kind}"):
            load_yaml(path)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1:30:00", "1:30:00"),
        ("1:30.5", "1:30.5"),
        ("0x1F", 31),
        ("-1.5e+3", -1500.0),
        ("2001-01-02", datetime.date(2001, 1, 2)),
    ],
)
def test_plain_values_are_what_yaml_says_but_in_base_60_they_are_text(text, value):
    found = parse_yaml(f"a: {text}", "mine.yaml")["a"]
    assert (found, type(found)) == (value, type(value))


@pytest.mark.parametrize(
    "text", ["a: {b: [1, .5]}", "? [a]\n: 1", "a: 1:30", "a: &x 1\nb: *x", "a: ["]
)
def test_without_libyaml_it_is_the_same(monkeypatch, text):
    def outcome():
        try:
            return parse_yaml(text, "mine.yaml")
        except ConfigError as error:
            return type(error)

    expected = outcome()
    monkeypatch.setattr(yaml_text, "_PARSER", yaml.SafeLoader)
    assert outcome() == expected


def test_overrides_are_yaml_and_make_the_mappings_that_they_need():
    content = {"a": 1, "b": {"c": [1, {"d": 2}]}}
    changed = apply_overrides(
        content, ["a=two", "b.e=[1, 2]", "x.y.z=true", "n=", "s='a=b'", " t = 1.5"]
    )
    assert changed == {
        "a": "two",
        "b": {"c": [1, {"d": 2}], "e": [1, 2]},
        "x": {"y": {"z": True}},
        "n": None,
        "s": "a=b",
        "t": 1.5,
    }


def test_overrides_leave_the_original_as_it_was():
    content = {"b": {"c": [1, {"d": 2}]}}
    changed = apply_overrides(content, ["b.e=1"])
    changed["b"]["c"][1]["d"] = 3
    assert content == {"b": {"c": [1, {"d": 2}]}}


def test_entries_of_a_list_are_set_by_their_number():
    content = {"tasks": [{"kp": 1}, {"kp": 2, "axes": ["x", "y"]}]}
    changed = apply_overrides(content, ["tasks.1.kp=5", "tasks.1.axes.0=z", "tasks.0={}"])
    assert changed == {"tasks": [{}, {"kp": 5, "axes": ["z", "y"]}]}
    assert content == {"tasks": [{"kp": 1}, {"kp": 2, "axes": ["x", "y"]}]}


def test_later_overrides_win():
    assert apply_overrides({}, ["a.b=1", "a.b=2"]) == {"a": {"b": 2}}
    assert apply_overrides({}, ["a.b=1", "a={}"]) == {"a": {}}


@pytest.mark.parametrize(
    ("override", "key"),
    [
        ("a", "a"),
        ("=1", ""),
        ("a..b=1", "a..b"),
        ("a.=1", "a."),
        ('"a.b=1', '"a.b'),
        (".a=1", ".a"),
        ("a={", "a"),
        ("a=2001-99-99", "a"),
        ("a=*x", "a"),
        ("n.b=1", "n.b"),
        ("l.0.b=1", "l.0.b"),
        ("l.1=1", "l.1"),
        ("l.-1=1", "l.-1"),
        ("l.first=1", "l.first"),
        ("e.0=1", "e.0"),
        ("m.n.o.p=1", "m.n.o.p"),
        ("a" + ".a" * 60 + "=1", "a" + ".a" * 60),
        ("a={[b]: 1}", "a"),
    ],
)
def test_an_override_that_cannot_be_is_told(override, key):
    with pytest.raises(ConfigError, match="--set") as caught:
        apply_overrides({"n": 1, "l": [1], "e": [], "m": {"n": "x"}}, [override])
    assert (caught.value.file, caught.value.key) == ("--set", key)
    assert caught.value.remedy


@pytest.mark.parametrize(
    "text", ["gamma: 0.1\ngamma: 0.9\n", "a: {b: 1, b: 2}\n", "'a': 1\na: 2\n"]
)
def test_a_key_that_stands_there_twice_is_refused_by_its_line(text):
    with pytest.raises(ConfigError, match=r"^mine\.yaml.*line \d"):
        parse_yaml(text, "mine.yaml")


def test_endpoints_of_other_protocols_and_of_ipv6_are_taken():
    parse(LinkSettings, {"connect": ["unixsock-stream//tmp/x", "tcp/[::1]:7447"]}, "mine.yaml")


class Figures(Settings):
    """Numbers without bounds of their own."""

    rate: float = 0.0
    place_m: tuple[float, ...] = ()
    points: tuple[tuple[float, ...], ...] = ()
    count: int = 0
    offset_m: tuple[float, float] = Field((0.0, 0.0), description="of the plane [m]")
    shares: dict[str, float] = Field({})


@pytest.mark.parametrize(
    "content",
    [
        {"rate": 1e300}, {"rate": -1e13}, {"rate": 1e-308}, {"rate": -1e-300}, {"count": 10**30},
        {"place_m": [0.0, 1e300, 0.0]}, {"points": [[0.0], [1e300]]}, {"shares": {"elbow": 1e300}},
    ],
)  # fmt: skip
def test_numbers_that_no_unit_explains_are_refused(content):
    (key,) = content
    with pytest.raises(ConfigError) as caught:
        parse(Figures, content, "mine.yaml")
    assert (caught.value.file, caught.value.key) == ("mine.yaml", key)


def test_a_number_in_parameters_is_named_with_its_key():
    config = {"controller": "qp12", "parameters": {"target_m": [1e300, 0.0, 0.0]}}
    with pytest.raises(ConfigError) as caught:
        check_parameters(parse(ControllerConfig, config, "mine.yaml"), "mine.yaml")
    assert caught.value.key == "parameters.target_m"


@pytest.mark.parametrize(
    ("value", "key"), [(3, "offset_m"), ([1], "offset_m.1"), ([1, "a"], "offset_m.1")]
)
def test_a_wrong_value_is_told_what_it_is_with_its_unit(value, key):
    with pytest.raises(ConfigError, match=r"\[m\]") as caught:
        parse(Figures, {"offset_m": value}, "mine.yaml")
    assert caught.value.key == key


def test_numbers_of_all_units_are_taken():
    content = {"rate": -1e12, "place_m": [0.0, 7e-33, 1e9], "count": 2**62}
    found = parse(Figures, content, "mine.yaml")
    assert (found.rate, found.place_m, found.count) == (-1e12, (0.0, 7e-33, 1e9), 2**62)


@pytest.mark.parametrize(
    ("text", "remedy"),
    [
        ("<?xml version='1.0'?><!-- a licence --><mujoco model='arm'/>", "plant.parameters.mjcf"),
        ("\ufeff<mujoco/>", "plant.parameters.mjcf"),
        ("<sdf version='1.7'/>", "SDF"),
        ("<robot name='arm'/>", "*.urdf"),
        ("version https://git-lfs.github.com/spec/v1\noid sha256:abc\nsize 12\n", "git lfs pull"),
    ],
)
def test_another_format_is_called_by_its_name(tmp_path, text, remedy):
    path = tmp_path / "arm.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_yaml(path)
    assert remedy in str(caught.value)
    assert "YAML" not in str(caught.value).replace("a YAML file", "")
