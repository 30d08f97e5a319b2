"""What the secure profile adds to a session: TLS, and who may do what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.secure.access import read_access
from hoap3.protocol.secure.access_rules import client_rules, robot_rules
from hoap3.protocol.secure.credentials import Credentials, read_credentials


@dataclass(frozen=True)
class Profile:
    """Parts of a Zenoh session's settings.

    Attributes:
        credentials: ours.
        access_control: Zenoh's.
    """

    credentials: Credentials
    access_control: dict[str, Any]

    def link(self) -> dict[str, Any]:
        """Zenoh's `transport/link`: nothing but TLS."""
        return {"protocols": ["tls"], "tls": self.credentials.tls()}


def profile(directory: str, robot: str, listen: Sequence[str], connect: Sequence[str]) -> Profile:
    """The profile of a session: of a robot where it listens, else of a client.

    Args:
        directory: of the credentials.
        robot: name of the robot; of a client "" where it asks who is there.
        listen, connect: the endpoints of the session.

    Raises:
        ConfigError: what lies there is wrong, or not for this purpose.
        NotInstalledError: cryptography is not installed.
    """
    credentials = read_credentials(directory)
    file, name, role = str(credentials.certificate), credentials.name, credentials.role
    if listen and connect:
        problem = "is for a robot that listens, or a client that connects, not both"
        raise ConfigError(directory, "", None, problem, "Leave out link.connect or link.listen")
    if listen:
        if role != "robot":
            remedy = f"Issue one: `hoap3 certs issue {robot} --role robot`"
            raise ConfigError(file, "", name, f"is of role {role}, and a robot listens", remedy)
        if name != robot:
            remedy = f"Set name={name}, or `hoap3 certs issue {robot} --role robot`"
            problem = f"is that of robot {name!r}, and this one is called {robot!r}"
            raise ConfigError(file, "", None, problem, remedy)
        access = read_access(credentials.directory)
        return Profile(credentials, robot_rules(robot, access.roles))
    if role == "robot":
        remedy = "Issue one of another role, such as `hoap3 certs issue anna --role operator`"
        raise ConfigError(file, "", name, "is a robot's, which does not connect", remedy)
    return Profile(credentials, client_rules(robot))
