"""Strict settings from YAML: an unknown key, a wrong type or an unfit value is one clear error.

The models that both services share stand here; each service adds its own.
"""

from __future__ import annotations

import difflib
import typing
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, ValidationError
from pydantic_core import ErrorDetails, core_schema

from protocol.errors import LONGEST_GUESS, ConfigError
from protocol.regular_file import read_at_most
from protocol.strict_numbers import make_strict
from protocol.yaml_text import MAX_BYTES as MAX_CONFIG_BYTES
from protocol.yaml_text import read_yaml

MAX_PARTS = 32  # of a dotted key
LIKE = 0.6  # the least likeness, of 1, of a key that is suggested
MOST_MEMBERS = 50  # of a union that are named in one error
NAME_PATTERN = r"^[a-z][a-z0-9_]{0,31}$"
RobotName = Annotated[str, Field(pattern=NAME_PATTERN)]
ENDPOINT_PATTERN = r"^[a-z][a-z-]*/\S+$"
Endpoint = Annotated[str, Field(pattern=ENDPOINT_PATTERN)]

Model = TypeVar("Model", bound="Settings")


class Settings(BaseModel):
    """Base of every settings model: unknown keys are errors, values cannot be changed later."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        """Numbers are numbers: neither `true` nor "3" passes for one."""
        schema = handler(source)
        make_strict(schema)
        return schema


class LinkSettings(Settings):
    """How a service reaches the network.

    Endpoints are Zenoh's, such as `tcp/127.0.0.1:7447`. Nothing listens beyond loopback unless
    an endpoint says so; nothing is discovered by itself.
    """

    listen: tuple[Endpoint, ...] = Field((), description="endpoints to listen on")
    connect: tuple[Endpoint, ...] = Field((), description="endpoints to connect to")
    mode: Literal["peer", "client"] = Field("peer", description="client: everything by a router")
    lease_ms: int = Field(
        1000, strict=True, ge=100, le=60_000, description="silence after which a peer is gone"
    )


CpuNumber = Annotated[int, Field(strict=True, ge=0)]


class RealtimeSettings(Settings):
    """What a service asks of the operating system; what is refused is reported, never fatal."""

    policy: Literal["auto", "none"] = Field("auto", description="auto: SCHED_FIFO if allowed")
    priority: int = Field(80, strict=True, ge=1, le=98, description="SCHED_FIFO priority")
    cpu: Literal["auto", "none"] | CpuNumber = Field(
        "auto", description="auto: a CPU that no other run has claimed; none; or its number"
    )
    lock_memory: bool = Field(True, strict=True, description="keep pages in memory")
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
    file_mb: int = Field(250, strict=True, ge=1, description="a new file begins beyond this")


def load_yaml(path: Path) -> dict[str, Any]:
    """Read a YAML mapping.

    Raises:
        ConfigError: missing, not a regular file, too large, not YAML, or not a mapping.
    """
    file = str(path)
    try:
        data = read_at_most(path, MAX_CONFIG_BYTES)
    except IsADirectoryError as error:
        raise ConfigError(file, "", None, "is a folder", "Name a YAML file") from error
    except OSError as error:
        reason = error.strerror or "cannot be read"
        raise ConfigError(file, "", None, reason, "Name a file that can be read") from error
    return parse_yaml(data, file)


def parse_yaml(data: bytes | str, file: str) -> dict[str, Any]:
    """Content of a YAML mapping that came from `file`.

    Raises:
        ConfigError: too large, not YAML, or not a mapping.
    """
    if len(data) > MAX_CONFIG_BYTES:
        problem = f"is larger than {MAX_CONFIG_BYTES >> 10} KiB"
        raise ConfigError(file, "", None, problem, "A config is a few lines")
    try:
        content = read_yaml(data)
    except yaml.YAMLError as error:
        raise ConfigError(
            file, "", None, f"is not valid YAML{_why(error)}", "Correct it"
        ) from error
    if content is None:
        return {}
    if not isinstance(content, dict) or not all(isinstance(key, str) for key in content):
        raise ConfigError(file, "", content, "is not a mapping", "Write `key: value` lines")
    return content


def apply_overrides(content: dict[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """A copy of `content` with each `dotted.key=value` of `overrides` set; values are YAML.

    The entries of a list are counted from 0.

    Raises:
        ConfigError: no `=`, a key below something that has none, an entry that a list does not
            have, or bad YAML.
    """
    result: dict[str, Any] = _copy(content)
    for override in overrides:
        key, equals, text = override.partition("=")
        parts = key.strip().split(".")
        if not equals or not all(parts):
            raise ConfigError("--set", key, override, "is not key=value", "Write --set a.b=1")
        if len(parts) > MAX_PARTS:
            problem = f"has {len(parts)} parts, at most {MAX_PARTS}"
            raise ConfigError("--set", key, None, problem, "Write --set a.b=1")
        try:
            value = read_yaml(text)
        except yaml.YAMLError as error:
            problem = f"is not a YAML value{_why(error)}"
            raise ConfigError("--set", key, text, problem, "Quote it") from error
        place: Any = result
        for part in parts[:-1]:
            place = _below(place, part, key)
        place[_where(place, parts[-1], key)] = value
    return result


def _why(error: yaml.YAMLError) -> str:
    """Where a YAML text is wrong, if known, and why."""
    mark = getattr(error, "problem_mark", None)
    place = f" at line {mark.line + 1}, column {mark.column + 1}" if mark else ""
    return f"{place}: {getattr(error, 'problem', None) or str(error).partition(chr(10))[0]}"


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
        ConfigError: naming the first wrong key, its value, and what is allowed.
    """
    try:
        return model.model_validate(content)
    except ValidationError as error:
        errors = error.errors(include_url=False)
        raise _config_error(model, content, errors, file, prefix) from error


def _config_error(
    model: type[BaseModel], content: Any, errors: list[ErrorDetails], file: str, prefix: str
) -> ConfigError:
    error = errors[0]
    if error["type"] == "missing":  # perhaps it is there, and misspelt
        error = next((each for each in errors if each["type"] == "extra_forbidden"), error)
    path = _written(content, error)
    key = ".".join([prefix, *path] if prefix else path)
    if error["type"] == "extra_forbidden":
        known = _keys_at(model, path[:-1])
        close = _nearest_key(path[-1], known)
        guess = f"Did you mean {close!r}? " if close else ""
        remedy = f"{guess}Known keys: {', '.join(sorted(known)) or 'none'}"
        return ConfigError(file, key, error["input"], "unknown key", remedy)
    if error["type"] == "missing":
        return ConfigError(file, key, None, "is missing", "Add it")
    if error["type"] == "union_tag_not_found":
        return ConfigError(file, f"{key}.kind", None, "is missing", "Add it")
    if error["type"] == "too_short" and isinstance(error["input"], list | tuple):
        least, found = error["ctx"]["min_length"], error["ctx"]["actual_length"]
        outer = _models_at(model, path[:-1])
        named = path and path[-1].endswith("s") and _models_below(outer, path[-1])
        entries = path[-1] if named else "values"
        wanted = f"one {entries.removesuffix('s')}" if least == 1 else f"{least} {entries}"
        problem = f"needs a list of {wanted} or more, has {found}"
        return ConfigError(file, key, error["input"], problem, "Add to the list")
    siblings = errors[:MOST_MEMBERS]
    members = [_plain(each["msg"]) for each in siblings if _written(content, each) == path]
    return ConfigError(file, key, error["input"], ", or ".join(members), "Change the value")


def likeness(given: str, known: Sequence[str]) -> float:
    """How like the most similar of the known keys is, 1 for the same; see `_nearest_key`."""
    return max((_alike(given, key) for key in known), default=0.0)


def _alike(given: str, key: str) -> float:
    if len(given) > LONGEST_GUESS:
        return 0.0
    begin = "_".join(key.split("_")[: given.count("_") + 1])
    return max(difflib.SequenceMatcher(None, given, each).ratio() for each in (key, begin))


def _nearest_key(given: str, known: Sequence[str]) -> str | None:
    """The key most like what was given, with or without the words at its end, such as a unit."""
    best = max(known, key=lambda key: _alike(given, key), default=None)
    return best if best is not None and _alike(given, best) >= LIKE else None


def _plain(message: str) -> str:
    message = message.removeprefix("Value error, ").removeprefix("Input ")
    message = message.replace("valid tuple", "valid list")  # what it is called in YAML
    return message[:1].lower() + message[1:]


def _written(content: Any, error: ErrorDetails) -> list[str]:
    """Path to the error in what users wrote; pydantic also names the tried member of a union."""
    path: list[str] = []
    for part in error["loc"]:
        listed = isinstance(content, list | tuple) and isinstance(part, int) and part < len(content)
        if listed or (isinstance(content, dict) and part in content):
            content = content[part]
            path.append(str(part))
    if error["type"] == "missing":
        path.append(str(error["loc"][-1]))
    return path


def _keys_at(model: type[BaseModel], path: Sequence[str]) -> list[str]:
    """Keys that the model knows at a path inside it."""
    names = (name for inner in _models_at(model, path) for name in inner.model_fields)
    return list(dict.fromkeys(names))


def _models_at(model: type[BaseModel], path: Sequence[str]) -> list[type[BaseModel]]:
    """The model, or those that it takes, at a path inside it."""
    here: list[type[BaseModel]] = [model]
    for part in path:
        here = _models_below(here, part) or here
    return here


def _models_below(models: Sequence[type[BaseModel]], key: str) -> list[type[BaseModel]]:
    """What models take under a key of theirs."""
    fields = [model.model_fields[key] for model in models if key in model.model_fields]
    return [inner for field in fields for inner in _models_in(field.annotation)]


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    """The models that a field takes, also as entries of a list."""
    if typing.get_origin(annotation) is None:
        found = isinstance(annotation, type) and issubclass(annotation, BaseModel)
        return [annotation] if found else []
    return [model for part in typing.get_args(annotation) for model in _models_in(part)]


def _copy(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: _copy(value) for key, value in content.items()}
    if isinstance(content, list):
        return [_copy(value) for value in content]
    return content
