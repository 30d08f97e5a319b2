"""What is wrong with settings, in words: pydantic's errors as one `ConfigError`.

Each wrong place is told once, also where a union tried several models on it.
"""

from __future__ import annotations

import difflib
import re
import typing
from collections.abc import Sequence
from typing import Any

from pydantic import BaseModel
from pydantic_core import ErrorDetails

from hoap3.protocol.config.dotted_keys import join_key
from hoap3.protocol.errors import LONGEST_GUESS, ConfigError
from hoap3.protocol.former_names import find_former_name

LIKE = 0.6  # the least likeness, of 1, of a key that is suggested,
MISSPELT = 0.7  # and of one that it rather is than a key inside `parameters`
MOST_ERRORS = 50  # of pydantic's that are looked at
MOST_TOLD = 10  # places that are told,
LONGEST = 1300  # characters in all; a hostile file gets no long answer
_NAME = re.compile(rf"[\w.:]{{1,{LONGEST_GUESS}}}")
_INSTANCE = re.compile(r" or instance of \w+$")
_MAPPING = "should be a mapping", "Write `key: value` lines below the key"
_TEXTS = {
    **dict.fromkeys(("dict_type", "model_type", "model_attributes_type"), _MAPPING),
    "bool_type": ("should be a valid boolean", "Write true or false, without quotes"),
    "string_too_short": ("should not be empty", "Write at least {min_length} characters"),
    "too_long": ("has {actual_length} values, at most {max_length} are taken", "Leave some out"),
    "union_tag_invalid": ("should be one of {expected_tags}", "Choose one of them"),
}
"""Problem and remedy by pydantic's type of error, in place of its own text."""
NAME_PATTERN = r"^[a-z][a-z0-9_]{0,31}$"
ROBOT_PATTERN = NAME_PATTERN + "|[/.:]"  # the name of a robot, or a path
NAME_RULE = "is not a name of at most 32 letters a-z, digits and _ that starts with a letter"


def config_error(
    model: type[BaseModel], content: Any, errors: list[ErrorDetails], file: str, prefix: str
) -> ConfigError:
    """What pydantic found wrong, as one error; the others are in its `others`.

    Args:
        model: what was expected.
        content: what was found.
        errors: at least one.
        file: where it came from.
        prefix: dotted key under which `content` stands in that file.
    """
    found = [
        _in_words(model, content, error, errors, file, prefix)
        for error in _each_place_once(model, content, _without_echoes(errors[:MOST_ERRORS]))
    ]
    first, others = found[0], found[1:MOST_TOLD]
    while others and sum(len(str(error)) for error in [first, *others]) > LONGEST:
        others.pop()
    return ConfigError(first.file, first.key, first.value, first.problem, first.remedy, others)


def _without_echoes(errors: list[ErrorDetails]) -> list[ErrorDetails]:
    """Errors but those of a list that is too short only without its wrong entries."""
    return [
        error
        for error in errors
        if not (
            error["type"] == "too_short"
            and isinstance(error["input"], list | tuple)
            and len(error["input"]) >= error["ctx"]["min_length"]
        )
    ] or errors


def _each_place_once(
    model: type[BaseModel], content: Any, errors: Sequence[ErrorDetails]
) -> list[ErrorDetails]:
    """Errors at different places, unknown keys first if the first is a missing key.

    A missing key is not told where an unknown one beside it seems to be it, misspelt. Of a union
    only the errors of the member that was tried first are told.
    """
    unknown = [error for error in errors if error["type"] == "extra_forbidden"]
    if errors[0]["type"] == "missing":  # perhaps it is there, and misspelt
        errors = sorted(errors, key=lambda error: error["type"] != "extra_forbidden")
    taken = {_meant(model, _written(content, error)) for error in unknown}
    told: dict[tuple[str, ...], ErrorDetails] = {}
    members: dict[tuple[str, ...], str] = {}
    for error in errors:
        path = tuple(_written(content, error))
        place, member = _tried(content, error)
        of_another_member = members.setdefault(place, member) != member
        is_there = error["type"] == "missing" and path in taken
        if not of_another_member and not is_there:
            told.setdefault(path, error)
    return list(told.values()) or [errors[0]]


def _meant(model: type[BaseModel], path: Sequence[str]) -> tuple[str, ...]:
    """An unknown key's path with the key that it seems to be a misspelling of."""
    close = _nearest_key(path[-1], _keys_at(model, path[:-1]))
    return (*path[:-1], close or "")


def _tried(content: Any, error: ErrorDetails) -> tuple[tuple[str, ...], str]:
    """Place of the union that an error is of, and its member; "" where there is none."""
    path: list[str] = []
    parts = error["loc"][:-1] if error["type"] == "missing" else error["loc"]
    for part in parts:
        if not _holds(content, part):
            return tuple(path), str(part)
        content = content[part]
        path.append(str(part))
    return tuple(path), ""


def _holds(content: Any, part: int | str) -> bool:
    """Whether a mapping has that key, or a list that entry."""
    if isinstance(content, list | tuple):
        return isinstance(part, int) and part < len(content)
    return isinstance(content, dict) and part in content


def _in_words(
    model: type[BaseModel],
    content: Any,
    error: ErrorDetails,
    errors: list[ErrorDetails],
    file: str,
    prefix: str,
) -> ConfigError:
    """One of the errors; those of other members of a union at the same place are told with it."""
    path = _written(content, error)
    key = ".".join(filter(None, (prefix, join_key(path))))
    if error["type"] == "extra_forbidden":
        inside = content
        for part in error["loc"][:-1]:
            inside = inside[part] if _holds(inside, part) else inside
        known = _keys_at(model, path[:-1], inside)
        former = find_former_name("config key", path[-1])
        if former and (former.new is None or former.new in known):
            return ConfigError(file, key, error["input"], former.problem, former.remedy)
        close = _nearest_key(path[-1], known)
        guess = f"Did you mean {close!r}? " if close else ""
        guess = _hint(model, path, close) or guess
        remedy = f"{guess}Known keys: {', '.join(sorted(known)) or 'none'}"
        return ConfigError(file, key, error["input"], "unknown key", remedy)
    if error["type"] in {"missing", "union_tag_not_found"}:
        place = key
        if error["type"] == "union_tag_not_found":
            place = f"{key}.{error['ctx']['discriminator'].strip(chr(39))}"
        return ConfigError(file, place, None, "is missing", f"Add it{_meaning(model, path)}")
    if error["type"] == "too_short" and isinstance(error["input"], list | tuple):
        least, found = error["ctx"]["min_length"], error["ctx"]["actual_length"]
        outer = _models_at(model, path[:-1])
        named = path and path[-1].endswith("s") and models_below(outer, path[-1])
        entries = path[-1] if named else "values"
        wanted = f"one {entries.removesuffix('s')}" if least == 1 else f"{least} {entries}"
        problem = f"needs a list of {wanted} or more, has {found}"
        return ConfigError(file, key, error["input"], problem, "Add to the list")
    siblings = [each for each in errors[:MOST_ERRORS] if _written(content, each) == path]
    members = dict.fromkeys(map(_problem, siblings))
    context, value = error.get("ctx", {}), error["input"]
    remedy = context.get("remedy") or _remedy(model, path, error)
    if error["type"] == "union_tag_invalid":
        key, value = f"{key}.{context['discriminator'].strip(chr(39))}", context["tag"]
    return ConfigError(file, key, value, ", or ".join(members), remedy)


def _problem(error: ErrorDetails) -> str:
    """What is wrong with a value, without pydantic's own terms."""
    context = error.get("ctx", {})
    if (pattern := context.get("pattern")) in {NAME_PATTERN, ROBOT_PATTERN}:
        return NAME_RULE + (", nor a path" if pattern == ROBOT_PATTERN else "")
    text = _TEXTS.get(error["type"], ("",))[0]
    return text.format(**context) if text else _plain(error["msg"])


def _remedy(model: type[BaseModel], path: Sequence[str], error: ErrorDetails) -> str:
    """What to write; of a name in the place of settings that have one, where that belongs."""
    value, (_, remedy) = error["input"], _TEXTS.get(error["type"], ("", "Change the value"))
    below = models_below(_models_at(model, path[:-1]), path[-1]) if path else []
    named = isinstance(value, str) and _NAME.fullmatch(value)
    if named and any("kind" in inner.model_fields for inner in below):
        return f"Write {path[-1]}: {{kind: {value}}}"
    if remedy == "Change the value":
        return remedy + _meaning(model, path)
    return remedy.format(**error.get("ctx", {}))


def _meaning(model: type[BaseModel], path: Sequence[str]) -> str:
    """What a value is, with its unit, to be added to a remedy; "" where its model has no word."""
    while path and path[-1].isdecimal():
        path = path[:-1]
    fields = [each.model_fields.get(path[-1]) for each in _models_at(model, path[:-1]) if path]
    return next((f": {field.description}" for field in fields if field and field.description), "")


def _hint(model: type[BaseModel], path: Sequence[str], close: str | None) -> str:
    """Where an unknown key belongs, or "" where nothing is known of it."""
    key, here = path[-1], _models_at(model, path[:-1])
    for inner in here:
        if hint := getattr(inner, "hints", {}).get(key):
            return f"{hint}. "
    own = [inner.model_fields["parameters"] for inner in here if "parameters" in inner.model_fields]
    if not own or (close and _alike(key, close) >= MISSPELT):
        return ""
    return f"Write {own[0].description} inside `parameters`. "


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
    message = _INSTANCE.sub("", message)  # which nobody can write there
    return message[:1].lower() + message[1:]


def _written(content: Any, error: ErrorDetails) -> list[str]:
    """Path to the error in what users wrote; pydantic also names the tried member of a union."""
    path: list[str] = []
    for part in error["loc"]:
        if _holds(content, part):
            content = content[part]
            path.append(str(part))
    if error["type"] == "missing":
        path.append(str(error["loc"][-1]))
    return path


def _keys_at(model: type[BaseModel], path: Sequence[str], content: Any = None) -> list[str]:
    """Keys that the model has at a path inside it; of a union, those of the kind in `content`."""
    models = _models_at(model, path)
    models = [inner for inner in models if _is_kind(inner, content)] or models
    return list(dict.fromkeys(name for inner in models for name in inner.model_fields))


def _is_kind(model: type[BaseModel], content: Any) -> bool:
    """Whether a mapping is of the kind, or shape, that a member of a union describes."""
    if not isinstance(content, dict):
        return False
    return all(
        content.get(name, field.default) in typing.get_args(field.annotation)
        for name, field in model.model_fields.items()
        if name in {"kind", "shape"}
    )


def _models_at(model: type[BaseModel], path: Sequence[str]) -> list[type[BaseModel]]:
    """The model, or those that it takes, at a path inside it."""
    here: list[type[BaseModel]] = [model]
    for part in path:
        here = models_below(here, part) or here
    return here


def models_below(models: Sequence[type[BaseModel]], key: str) -> list[type[BaseModel]]:
    """What models take under a key of theirs."""
    fields = [model.model_fields[key] for model in models if key in model.model_fields]
    return [inner for field in fields for inner in _models_in(field.annotation)]


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    """The models that a field takes, also as entries of a list."""
    if typing.get_origin(annotation) is None:
        found = isinstance(annotation, type) and issubclass(annotation, BaseModel)
        return [annotation] if found else []
    return [model for part in typing.get_args(annotation) for model in _models_in(part)]
