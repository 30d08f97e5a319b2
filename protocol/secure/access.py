"""Whom a robot lets in: `access.yaml` beside its certificate, names by role."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Self

import yaml
from pydantic import Field, field_validator, model_validator

from hoap3.protocol.config.settings import RobotName, Settings, load_yaml, parse
from hoap3.protocol.secure.roles import Role

ACCESS_FILE = "access.yaml"
_LISTS: dict[Role, str] = {
    "controller": "controllers",
    "operator": "operators",
    "observer": "observers",
    "admin": "admins",
}


class Access(Settings):
    """Common names of the certificates that a robot accepts; all others are turned away."""

    controllers: tuple[RobotName, ...] = Field((), description="may take authority")
    operators: tuple[RobotName, ...] = Field((), description="may steer, change and stop")
    observers: tuple[RobotName, ...] = Field((), description="may only read")
    admins: tuple[RobotName, ...] = Field((), description="may stop, recover and release")

    @field_validator("*", mode="before")
    @classmethod
    def _nobody(cls, names: Any) -> Any:
        """`operators:` with nothing behind it is a list of nobody."""
        return () if names is None else names

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        names = [name for _, name in self._entries()]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"each name should have one role, not several: {', '.join(twice)}")
        return self

    @property
    def roles(self) -> Mapping[str, Role]:
        """The role of each name."""
        return {name: role for role, name in self._entries()}

    def with_name(self, name: str, role: Role) -> Access:
        """The same, with one name more."""
        lists = {key: getattr(self, key) for key in _LISTS.values()}
        lists[_LISTS[role]] = (*lists[_LISTS[role]], name)
        return Access(**lists)

    def without(self, name: str) -> Access:
        """The same, without a name."""
        lists = {key: getattr(self, key) for key in _LISTS.values()}
        return Access(
            **{key: tuple(each for each in names if each != name) for key, names in lists.items()}
        )

    def to_yaml(self) -> str:
        """The content of a file."""
        content = {key: list(getattr(self, key)) for key in _LISTS.values()}
        return yaml.safe_dump(content, sort_keys=False)

    def _entries(self) -> Iterator[tuple[Role, str]]:
        for role, key in _LISTS.items():
            for name in getattr(self, key):
                yield role, name


def read_access(directory: Path) -> Access:
    """Whom the robot lets in whose certificate lies in a directory.

    Raises:
        ConfigError: the list is missing or wrong.
    """
    path = directory / ACCESS_FILE
    return parse(Access, load_yaml(path), str(path))
