"""What is compared: `[LABEL=]CONTROLLER[@KEY=VALUE,…]` as a checked config with a label."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hoap3.protocol.config.settings import apply_overrides, parse
from hoap3.protocol.errors import ConfigError, UsageError
from hoap3.remote_controller.config import ControllerConfig, check_parameters, read_config
from hoap3.remote_controller.registry import find
from hoap3.tools.logs.motion_files import enclosed

_SETTINGS = re.compile(r"@(?=[A-Za-z_][\w.]*=)")
_LABEL = re.compile(r"([\w-]+)=")
_OPEN, _CLOSE, _QUOTES = "[{", "]}", "\"'"


@dataclass(frozen=True)
class Candidate:
    """One of the controllers that are compared.

    Attributes:
        label: what it is called, unlike all others.
        words: as it was written; stands for the file in errors.
        config: its settings, checked.
    """

    label: str
    words: str
    config: ControllerConfig

    @property
    def parameters(self) -> dict[str, Any]:
        """All parameters of the controller, defaults included."""
        model = find(self.config.controller, self.words).Parameters
        whole = parse(model, self.config.parameters, self.words, "parameters")
        found: dict[str, Any] = whole.model_dump(mode="json")
        return found


def read_candidates(words: Sequence[str]) -> list[Candidate]:
    """Read all that shall be compared; a label that was there before gets a number.

    Raises:
        UsageError: fewer than two, or one of them is wrong.
    """
    if len(words) < 2:
        raise UsageError(
            f"compare: {len(words)} controller is too few. Name at least two, or one at two "
            "settings, such as `hoap3 compare qp12@gamma=0 qp12@gamma=0.9`"
        )
    found: list[Candidate] = []
    for each in words:
        label, config = _read(each)
        taken = {one.label for one in found}
        number = 2
        name = label
        while name in taken:
            name, number = f"{label}#{number}", number + 1
        found.append(Candidate(name, each, config))
    return found


def split(words: str) -> tuple[str | None, str, list[str]]:
    """Label or None, name, and settings of one argument.

    What follows the first `@` before a `KEY=` are settings, divided by commas outside of brackets
    and quotes; an `@` elsewhere belongs to the name. A label holds letters, digits, `_` and `-`, so
    a path with `=` in it is written with a `/`.
    """
    begin = _SETTINGS.search(words)
    name, sets = (words[: begin.start()], words[begin.end() :]) if begin else (words, "")
    label = _LABEL.match(name)
    if label:
        name = name[label.end() :]
    return label[1] if label else None, name, _pieces(sets) if begin else []


def _read(words: str) -> tuple[str, ControllerConfig]:
    label, name, sets = split(words)
    if not name:
        raise ConfigError(words, "", None, "names no controller", "Write one, such as qp12")
    if "@" in name and not Path(name).exists():
        raise ConfigError(
            words,
            "",
            name.partition("@")[2],
            "is not KEY=VALUE",
            "Write settings as in qp12@gamma=0.1,psi_scale=one",
        )
    content, file = read_config(name)
    try:
        for each in sets:
            key, equals, _ = each.partition("=")
            if not equals or not key.strip():
                raise ConfigError("", key, each, "is not KEY=VALUE", "Put lists into brackets")
            content = apply_overrides(content, [f"parameters.{each.lstrip()}"])
    except ConfigError as error:
        raise ConfigError(words, error.key, error.value, error.problem, error.remedy) from error
    source = words if sets else file
    config = enclosed(parse(ControllerConfig, content, source), file)
    check_parameters(config, source)
    if label is None:
        stem = Path(name).stem if Path(name).suffix in {".yaml", ".yml"} else name
        label = "@".join(filter(None, [stem, ",".join(sets)]))
    return label, config


def _pieces(text: str) -> list[str]:
    """Text between commas that stand outside of brackets and quotes."""
    pieces: list[str] = []
    begin, depth, quote = 0, 0, ""
    for at, sign in enumerate(text):
        if quote:
            quote = "" if sign == quote else quote
        elif sign in _QUOTES:
            quote = sign
        elif sign in _OPEN or sign in _CLOSE:
            depth += 1 if sign in _OPEN else -1
        elif sign == "," and depth == 0:
            pieces.append(text[begin:at])
            begin = at + 1
    return [*pieces, text[begin:]]
