"""Strict settings from YAML: an unknown key, a wrong type or an unfit value is one clear error.

The models that both services share stand here; each service adds its own.
"""

from __future__ import annotations

import codecs
import copy
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar

import yaml
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic_core import PydanticCustomError, core_schema

from hoap3.protocol.config.dotted_keys import split_key
from hoap3.protocol.config.endpoints import Endpoint, beyond_this_machine, over_tls
from hoap3.protocol.config.regular_file import read_named
from hoap3.protocol.config.wrong_settings import NAME_PATTERN, config_error
from hoap3.protocol.config.yaml_text import MAX_BYTES as MAX_CONFIG_BYTES
from hoap3.protocol.config.yaml_text import read_yaml
from hoap3.protocol.errors import ConfigError

_NO_SCHEMAS = {"default", "metadata", "config", "cls", "serialization", "expected"}


def make_strict(schema: Any) -> None:
    """Take nothing else for every integer, float and boolean in a schema of pydantic."""
    if isinstance(schema, dict):
        if schema.get("type") in {"int", "float", "bool"}:
            schema["strict"] = True
        for key, inner in schema.items():
            if key not in _NO_SCHEMAS:
                make_strict(inner)
    elif isinstance(schema, list | tuple):
        for inner in schema:
            make_strict(inner)


HUGE, TINY = 1e12, 1e-30  # size of numbers in SI units
_SURROGATE = re.compile("[\ud800-\udfff]")  # a byte of a file's name that is not UTF-8
MAX_PARTS = 32  # of a dotted key
SNIFFED = 65_536  # bytes of a file in which XML formats are recognized
_ASSIGNED = re.compile(r'((?:"[^"]*"|[^"=])+)=')
XML_FORMATS = {
    "robot": ("is a URDF, not a config", "Name it as a robot, *.urdf: `hoap3 help robots`"),
    "mujoco": ("is MJCF, not URDF", "Name its URDF; plant.kind mujoco takes plant.parameters.mjcf"),
    "sdf": ("is SDF, not URDF", "Convert it, or name the vendor's URDF of this robot"),
    "COLLADA": ("is a mesh, not a URDF", "Name the URDF that names this mesh"),
}
"""By their outermost element: what they are called, and what to do."""
RobotName = Annotated[str, Field(pattern=NAME_PATTERN)]

_FIXES = {
    "a tab": "Indent with spaces",
    "cannot start a value": "Quote the text",
    "mapping values are not allowed": "Write one `key: value` a line, and quote text with a colon",
    "could not find expected ':'": "Write `key: value`, with a space behind the colon",
    "did not find expected": "Close each bracket and quote, and indent lines of one block alike",
    "unexpected end of stream": "Close each bracket and quote",
    "is not UTF-8": "Save it as UTF-8",
}
"""Remedy by a part of what a parser of YAML reports."""

Model = TypeVar("Model", bound="Settings")


class Settings(BaseModel):
    """Base of every settings model: unknown keys are errors, values cannot be changed later."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    hints: ClassVar[Mapping[str, str]] = {}  # of unknown keys: what to write instead

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        """Neither `true` nor "3" passes for a number, and no number for true or false."""
        schema = handler(source)
        make_strict(schema)
        return schema

    @field_validator("*")
    @classmethod
    def _check_value(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse what is not UTF-8, and numbers with which kernels overflow or never end."""
        field = cls.model_fields.get(str(info.field_name))
        if field is None or field.annotation != dict[str, Any]:  # those have a model of their own
            _check_value(value, TINY)
        return value


def _check_value(value: Any, least: float) -> None:
    if isinstance(value, str) and not value.isascii() and _SURROGATE.search(value):
        raise PydanticCustomError("utf8", "is not UTF-8", {"remedy": "Rename what is named so"})
    if isinstance(value, tuple | list | Mapping):
        for each in value.values() if isinstance(value, Mapping) else value:
            _check_value(each, 0.0)  # a component of a direction may be as small as rounding
    size = abs(value) if isinstance(value, int | float) else 0
    if size > (HUGE if isinstance(value, float) else 2**63) or 0 < size < least:
        raise ValueError(f"should be between {TINY:g} and {HUGE:g} in size, or 0")


Port = Annotated[int, Field(strict=True, ge=0, le=65_535)]


class Hoap3TcpSettings(Settings):
    """HOAP-3's own protocol, which tells neither a robot's name nor its description."""

    host: str = Field("127.0.0.1", description="IPv4 address to listen at, or of the robot")
    init_port: Port = Field(2600, description="where a client says how many exchanges it wants")
    control_port: Port = Field(2200, description="where it then exchanges frames")
    order: Literal["paper", "legacy"] = Field(
        "paper", description="who sends first; paper: the robot, legacy: the client"
    )
    slots: Literal[21, 22] = Field(21, description="doubles in a frame; the 22nd means nothing")
    check_s: int = Field(
        86_400,
        strict=True,
        ge=1,
        le=1_000_000,
        description="of a controller: CHECK_TIME, after which it connects anew",
    )
    robot: str = Field("hoap3", description="of a controller: shipped robot, or a description")

    @model_validator(mode="after")
    def _two_ports(self) -> Self:
        if self.init_port == self.control_port != 0:
            raise ValueError("init_port and control_port should differ")
        return self


class LinkSettings(Settings):
    """How a service reaches the network.

    Endpoints are Zenoh's, such as `tcp/127.0.0.1:7447`. Nothing listens beyond loopback unless
    an endpoint says so; nothing is discovered by itself.
    """

    kind: Literal["zenoh", "hoap3_tcp"] = Field(
        "zenoh", description="hoap3_tcp: HOAP-3's own protocol; the other keys are Zenoh's"
    )
    hoap3_tcp: Hoap3TcpSettings = Hoap3TcpSettings()
    listen: tuple[Endpoint, ...] = Field((), description="endpoints to listen on")
    connect: tuple[Endpoint, ...] = Field((), description="endpoints to connect to")
    mode: Literal["peer", "client"] = Field(
        "peer", description="client: everything goes through the router that connect names"
    )
    lease_ms: int = Field(
        1000, strict=True, ge=100, le=60_000, description="silence after which a peer is gone"
    )
    secure: str | None = Field(
        None,
        description="folder of a certificate, as `hoap3 certs issue` makes it: only TLS is spoken, "
        "and only to those whom the robot lists; null: plain",
    )
    insecure: bool = Field(
        False, strict=True, description="listen beyond this machine without a certificate"
    )

    @model_validator(mode="before")
    @classmethod
    def _default_endpoints_over_tls(cls, content: Any) -> Any:
        if not isinstance(content, dict) or not isinstance(content.get("secure"), str):
            return content
        defaults = {key: cls.model_fields[key].default for key in ("listen", "connect")}
        content = dict(content)
        for key, places in defaults.items():
            given = content.get(key, places)
            if isinstance(given, list | tuple) and tuple(given) == places:  # else it is refused
                content[key] = [over_tls(each) for each in places]
        return content

    @model_validator(mode="after")
    def _as_safe_as_said(self) -> Self:
        places = *self.listen, *self.connect
        plain = [place for place in places if not place.startswith("tls/")]
        if self.secure is not None and self.kind != "zenoh":
            raise _unsafe(f"{self.kind} has no certificates", "Leave out link.secure")
        if self.secure is not None and plain:
            raise _unsafe(
                f"with link.secure only TLS is spoken, not {plain[0]}",
                f"Write {over_tls(plain[0])}",
            )
        if self.secure is None and any(re.match(r"tls/[^#]*$", place) for place in places):
            raise _unsafe(
                "tls/ needs a certificate",
                "Give --secure DIR, or set link.secure (`hoap3 help operation`)",
            )
        open_to_all = [place for place in self.reachable if beyond_this_machine(place)]
        if open_to_all and self.secure is None and not self.insecure:
            key = "link.listen" if self.kind == "zenoh" else "link.hoap3_tcp.host"
            raise _unsafe(
                f"with this {key} whoever reaches {open_to_all[0]} could command the robot",
                "Use certificates: --secure DIR (`hoap3 help operation`); or allow it: --insecure",
            )
        return self

    @property
    def reachable(self) -> tuple[str, ...]:
        """Where others reach the service."""
        return self.listen if self.kind == "zenoh" else ()

    @property
    def places(self) -> tuple[str, ...]:
        """Where the service can be reached, or reaches others, in words."""
        if self.kind == "hoap3_tcp":
            return (f"hoap3_tcp/{self.hoap3_tcp.host}:{self.hoap3_tcp.init_port}",)
        return self.listen or self.connect


def _unsafe(problem: str, remedy: str) -> PydanticCustomError:
    return PydanticCustomError("unsafe", "{problem}", {"problem": problem, "remedy": remedy})


CpuNumber = Annotated[int, Field(strict=True, ge=0)]


class RealtimeSettings(Settings):
    """What a service asks of the operating system; what is refused is reported, never fatal."""

    policy: Literal["auto", "none"] = Field("auto", description="auto: SCHED_FIFO if allowed")
    priority: int = Field(80, strict=True, ge=1, le=98, description="SCHED_FIFO priority")
    cpu: Literal["auto", "none"] | CpuNumber = Field(
        "auto", description="auto: a CPU that no other run has claimed; none; or its number"
    )
    lock_memory: bool = Field(
        True, strict=True, description="keep pages in memory; not with policy: none"
    )
    keep_awake: bool = Field(
        True, strict=True, description="let a watched CPU never fall asleep when it is idle"
    )
    watch_stalls: Literal["auto", "none"] | tuple[CpuNumber, ...] = Field(
        "auto", description="CPUs whose stalls are noted; auto: the one that it is pinned to"
    )


class LogSettings(Settings):
    """What the observer process records."""

    record: bool = Field(True, strict=True, description="write an MCAP log")
    directory: str = Field("logs", description="a folder per run is made inside")
    cap_mb: int = Field(
        1000, strict=True, ge=1, description="the oldest files of a run go beyond this"
    )
    file_mb: int = Field(
        250,
        strict=True,
        ge=1,
        description="of one file, at most half the cap; then a further one begins",
    )
    keep_days: float | None = Field(
        None, gt=0, description="older runs in that directory are deleted at a start; null: none"
    )
    keep_mb: int | None = Field(
        None,
        strict=True,
        ge=1,
        description="beyond this the oldest runs in it are deleted at a start; null: any size",
    )
    json_lines: Literal["stdout"] | None = Field(
        None,
        description="stdout: a service writes JSON objects there, one a line, in place of lines "
        "for people; null: none",
    )


class MetricsSettings(Settings):
    """Where the observer process serves figures to Prometheus."""

    host: str = Field(
        "127.0.0.1", description="address to listen at; others than loopback are seen"
    )
    port: Annotated[int, Field(strict=True, ge=1, le=65_535)] | None = Field(
        None, description="port to listen at; null: none"
    )


def load_yaml(path: Path) -> dict[str, Any]:
    """Read a YAML mapping.

    Raises:
        ConfigError: missing, not a regular file, too large, a URDF, not YAML, empty, or not a
            mapping.
    """
    file = str(path)
    data = read_named(path, MAX_CONFIG_BYTES, file, "a YAML file")
    start = data.removeprefix(codecs.BOM_UTF8).lstrip()[:SNIFFED]
    for tag, (problem, remedy) in XML_FORMATS.items() if start.startswith(b"<") else ():
        if f"<{tag}".encode() in start:
            raise ConfigError(file, "", None, problem, remedy)
    return parse_yaml(data, file)


def parse_yaml(data: bytes | str, file: str) -> dict[str, Any]:
    """Content of a YAML mapping that came from `file`.

    Raises:
        ConfigError: too large, not YAML, empty, or not a mapping.
    """
    if len(data) > MAX_CONFIG_BYTES:
        problem = f"is larger than {MAX_CONFIG_BYTES >> 10} KiB"
        raise ConfigError(file, "", None, problem, "A config is a few lines")
    try:
        content = read_yaml(data)
    except yaml.YAMLError as error:
        why = _why(error, data)
        raise ConfigError(file, "", None, f"is not valid YAML{why}", _fix(why)) from error
    if content is None:
        remedy = "Write `key: value` lines, such as `robot: hoap3` or `controller: qp12`"
        raise ConfigError(file, "", None, "is empty", remedy)
    if not isinstance(content, dict) or not all(isinstance(key, str) for key in content):
        raise ConfigError(file, "", content, "is not a mapping", "Write `key: value` lines")
    return content


def apply_overrides(content: dict[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """A copy of `content` with each `dotted.key=value` of `overrides` set; values are YAML.

    The entries of a list are counted from 0. A part of the key with a dot in it stands in quotes.

    Raises:
        ConfigError: no `=`, a key below something that has none, an entry that a list does not
            have, or bad YAML.
    """
    result: dict[str, Any] = copy.deepcopy(content)
    for override in overrides:
        found = _ASSIGNED.match(override)
        key = (found[1] if found else override.partition("=")[0]).strip()
        parts, text = split_key(key), override[found.end() if found else 0 :]
        if found is None or not all(parts):
            remedy = (
                "Write --set a.b=1; a part with a dot in it stands in quotes: --set 'a.\"b.c\"=1'"
            )
            raise ConfigError("--set", key, override, "is not key=value", remedy)
        if len(parts) > MAX_PARTS:
            problem = f"has {len(parts)} parts, at most {MAX_PARTS}"
            raise ConfigError("--set", key, None, problem, "Write --set a.b=1")
        try:
            value = read_yaml(text)
        except yaml.YAMLError as error:
            why = _why(error, text)
            remedy = f"{_fix(why)}, and quote it for the shell"
            raise ConfigError("--set", key, text, f"is not a YAML value{why}", remedy) from error
        place: Any = result
        for part in parts[:-1]:
            place = _below(place, part, key)
        place[_where(place, parts[-1], key)] = value
    return result


def _why(error: yaml.YAMLError, text: bytes | str) -> str:
    """Where a YAML text is wrong, if known, and why."""
    mark = getattr(error, "problem_mark", None)
    place = f" at line {mark.line + 1}, column {mark.column + 1}" if mark else ""
    why = str(getattr(error, "problem", None) or str(error).partition("\n")[0])
    if mark and "cannot start any token" in why:
        lines = (text if isinstance(text, str) else text.decode(errors="replace")).split("\n")
        found = lines[mark.line][mark.column : mark.column + 1]
        why = "found a tab" if found == "\t" else f"found {found!r}, which cannot start a value"
    return f"{place}: {why}"


def _fix(why: str) -> str:
    """What to write instead, by what libyaml found."""
    return next((fix for part, fix in _FIXES.items() if part in why), "Correct that place")


def _below(place: Any, part: str, key: str) -> Any:
    """The mapping or list under `part`; an empty mapping where there is nothing yet."""
    where = _where(place, part, key)
    inner = place.setdefault(where, {}) if isinstance(place, dict) else place[where]
    if not isinstance(inner, dict | list):
        raise ConfigError("--set", key, inner, f"{part!r} has no keys below it", "Drop it")
    return inner


def _where(place: Any, part: str, key: str) -> str | int:
    """A key of a mapping as it is, or the index of a list's entry."""
    if isinstance(place, dict):
        if part not in place and (index := re.fullmatch(r"(\w+)\[(\w+)\]", part)):
            remedy = f"Write {key.replace(part, '.'.join(index.groups()))}"
            raise ConfigError("--set", key, None, "counts entries of a list with dots", remedy)
        return part
    entries = [str(i) for i in range(len(place))]
    if part not in entries:
        remedy = f"Give one of {', '.join(entries)}" if entries else "Set the whole list"
        raise ConfigError("--set", key, part, f"no such entry in a list of {len(place)}", remedy)
    return entries.index(part)


def parse(model: type[Model], content: dict[str, Any], file: str, prefix: str = "") -> Model:
    """`content` as a `model`.

    Args:
        model: what is expected.
        content: a mapping, as YAML gives it.
        file: where it came from, for the error.
        prefix: dotted key under which `content` stands in that file.

    Raises:
        ConfigError: naming each wrong key, its value, and what is allowed.
    """
    try:
        return model.model_validate(content)
    except ValidationError as error:
        errors = error.errors(include_url=False)
        raise config_error(model, content, errors, file, prefix) from error
