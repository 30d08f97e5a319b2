"""What an authority has issued: `register.yaml` beside its key."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import yaml
from pydantic import Field

from hoap3.protocol.config.settings import RobotName, Settings, load_yaml, parse
from hoap3.protocol.errors import UsageError
from hoap3.protocol.secure.roles import Role

REGISTER_FILE = "register.yaml"
SOON_DAYS = 30  # before its end, in which a certificate is said to expire soon


class Entry(Settings):
    """One certificate."""

    name: RobotName = Field(description="common name")
    role: Role = Field(description="what its holder may do")
    expires: str = Field(description="ISO 8601, UTC")
    revoked: bool = Field(False, description="whether its name has left the robots' lists")

    def state(self, now: datetime) -> str:
        """In a word: valid, expires soon, expired or revoked."""
        if self.revoked:
            return "revoked"
        days = (datetime.fromisoformat(self.expires) - now).total_seconds() / 86_400
        if days <= 0:
            return "expired"
        return "expires soon" if days < SOON_DAYS else "valid"

    def as_json(self) -> dict[str, str]:
        """For `hoap3 certs list --json`."""
        return {
            "name": self.name,
            "role": self.role,
            "expires": self.expires,
            "state": self.state(datetime.now(UTC)),
        }


class Register(Settings):
    """All of them, in the order in which they were issued."""

    certificates: tuple[Entry, ...] = ()

    def find(self, name: str) -> Entry | None:
        """The certificate of a name, if there is one."""
        return next((each for each in self.certificates if each.name == name), None)

    def get(self, name: str) -> Entry:
        """The certificate of a name that is in use.

        Raises:
            UsageError: there is none, or it was revoked.
        """
        entry = self.find(name)
        if entry is None:
            known = ", ".join(each.name for each in self.certificates) or "none"
            raise UsageError(f"no certificate is called {name!r}. Issued: {known}")
        if entry.revoked:
            raise UsageError(f"{name!r} was revoked: issue one under a new name")
        return entry

    def with_entry(self, entry: Entry) -> Register:
        """The same, with this certificate instead of the one of its name, or as the last."""
        if self.find(entry.name) is None:
            return Register(certificates=(*self.certificates, entry))
        others = [entry if each.name == entry.name else each for each in self.certificates]
        return Register(certificates=tuple(others))

    def to_yaml(self) -> str:
        """The content of a file."""
        return yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False)


def read_register(folder: Path) -> Register:
    """What the authority in a folder has issued.

    Raises:
        UsageError: there is no authority.
        ConfigError: its register is wrong.
    """
    path = folder / REGISTER_FILE
    if not path.is_file():
        raise UsageError(f"{folder}: holds no authority. Run `hoap3 certs init --dir {folder}`")
    return parse(Register, load_yaml(path), str(path))
