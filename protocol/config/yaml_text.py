"""Reads YAML that may be hostile: plain values only, in time that grows with the length.

What PyYAML's own safe loader takes and this one does not:

- aliases, with which a few lines unfold to any size; tags; `%` directives;
- lists and mappings as keys, and a key that stands twice in one mapping;
- numbers in base 60, such as 1:30:00, which are text here, while 1e-3 is a number;
- more than `MAX_VALUES` values, nests deeper than `MAX_DEPTH`, numbers of more than `MAX_NUMBER`
  characters.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import takewhile
from typing import Any

import yaml
from yaml.constructor import SafeConstructor
from yaml.resolver import Resolver

MAX_BYTES = 1 << 20 if yaml.__with_libyaml__ else 1 << 16  # PyYAML's own parser is slow
MAX_VALUES = 20_000
MAX_DEPTH = 32
MAX_NUMBER = 64  # characters

_PARSER: Any = yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader
_DIRECTIVE = re.compile(r"^%", re.MULTILINE)
_TEXT = "tag:yaml.org,2002:str"
_INTEGER = "tag:yaml.org,2002:int"
_FLOAT = "tag:yaml.org,2002:float"


class _Resolver(Resolver):
    """YAML 1.1 as PyYAML has it, but for numbers in base 60."""


_Resolver.yaml_implicit_resolvers = {
    first: [(tag, regexp) for tag, regexp in found if tag not in {_INTEGER, _FLOAT}]
    for first, found in Resolver.yaml_implicit_resolvers.items()
}
_Resolver.add_implicit_resolver(
    _INTEGER,
    re.compile(r"[-+]?(?:0b[01_]+|0x[0-9a-fA-F_]+|0[0-7_]+|0|[1-9][0-9_]*)$"),
    list("-+0123456789"),
)
_Resolver.add_implicit_resolver(
    _FLOAT,
    re.compile(
        r"(?:[-+]?(?:[0-9][0-9_]*\.[0-9_]*|\.[0-9][0-9_]*)(?:[eE][-+][0-9]+)?"
        r"|[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)[eE][-+]?[0-9]+"  # YAML 1.1 takes 1e-3 for text
        r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$"
    ),
    list("-+0123456789."),
)


def read_yaml(data: bytes | str) -> Any:
    """What a YAML text says: mappings, lists, text, numbers, booleans, dates, None.

    Raises:
        yaml.YAMLError: larger than `MAX_BYTES`, not UTF-8, not YAML, or one of the things above;
            `problem` and `problem_mark` say what and where, if it has a place.
    """
    if len(data) > MAX_BYTES:
        raise yaml.YAMLError(f"has {len(data)} bytes, at most {MAX_BYTES} are read")
    try:
        text = data if isinstance(data, str) else data.decode("utf-8-sig")
        if _DIRECTIVE.search(text):
            raise yaml.YAMLError("a line begins with %, and directives are not taken")
        return _Document(yaml.parse(text, _PARSER)).content()
    except UnicodeDecodeError as error:
        byte, place = error.object[error.start], error.start
        raise yaml.YAMLError(f"byte {place} (0x{byte:02x}) is not UTF-8") from error
    except ValueError as error:  # such as 2001-99-99
        raise yaml.YAMLError(f"a date cannot be read ({error})") from error


class _Document:
    """Builds values from the events of the parser."""

    def __init__(self, events: Iterator[yaml.Event]) -> None:
        self._events = events
        self._resolver: Any = _Resolver()
        self._constructor = SafeConstructor()
        self._left = MAX_VALUES

    def content(self) -> Any:
        """The only document of the stream, or None."""
        next(self._events)  # the begin of the stream
        if isinstance(next(self._events), yaml.StreamEndEvent):
            return None
        value = self._value(next(self._events), 0)
        next(self._events)  # the end of the document
        more = next(self._events)
        if not isinstance(more, yaml.StreamEndEvent):
            raise _error("another document begins", more)
        return value

    def _value(self, event: yaml.Event, depth: int) -> Any:
        self._left -= 1
        if self._left < 0:
            raise _error(f"more than {MAX_VALUES} values", event)
        if depth > MAX_DEPTH:
            raise _error(f"a nest deeper than {MAX_DEPTH}", event)
        if isinstance(event, yaml.AliasEvent):
            raise _error("aliases are not taken", event)
        if getattr(event, "tag", None) is not None:
            raise _error("tags are not taken", event)
        if isinstance(event, yaml.MappingStartEvent):
            return self._mapping(depth)
        if isinstance(event, yaml.SequenceStartEvent):
            return self._list(depth)
        return self._scalar(event)

    def _mapping(self, depth: int) -> dict[Any, Any]:
        found: dict[Any, Any] = {}
        seen: set[str] = set()
        for event in self._until(yaml.MappingEndEvent):
            if isinstance(event, yaml.MappingStartEvent | yaml.SequenceStartEvent):
                what = "mapping" if isinstance(event, yaml.MappingStartEvent) else "list"
                raise _error(f"a {what} cannot be a key", event)
            key = self._value(event, depth + 1)
            text = getattr(event, "value", "")
            if text in seen:
                raise _error(f"the key {text!r:.60} stands there twice", event)
            seen.add(text)
            found[key] = self._value(next(self._events), depth + 1)
        return found

    def _list(self, depth: int) -> list[Any]:
        return [self._value(event, depth + 1) for event in self._until(yaml.SequenceEndEvent)]

    def _until(self, end: type[yaml.Event]) -> Iterator[yaml.Event]:
        return takewhile(lambda event: not isinstance(event, end), self._events)

    def _scalar(self, event: Any) -> Any:
        text: str = event.value
        tag = self._resolver.resolve(yaml.ScalarNode, text, event.implicit)
        if tag == _TEXT:
            return text
        if tag in {_INTEGER, _FLOAT} and len(text) > MAX_NUMBER:
            raise _error(f"a number of {len(text)} characters, at most {MAX_NUMBER}", event)
        node = yaml.ScalarNode(tag, text, event.start_mark, event.end_mark)
        return self._constructor.construct_object(node)


def _error(problem: str, event: yaml.Event) -> yaml.MarkedYAMLError:
    mark: Any = event.start_mark
    return yaml.MarkedYAMLError(problem=problem, problem_mark=mark)
