"""A robot, its holder, and attackers who know all that it tells."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from pathlib import Path
from typing import Any

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.link.zenoh_link import ZenohControllerLink
from hoap3.protocol.link.zenoh_session import ask, key, open_session, session_name, zenoh
from hoap3.protocol.messages import State
from hoap3.tools.services.certificates import issue
from support.attacks.attacked_robot import AttackedRobot
from support.certificates.laboratory import DAY, client, laboratory

PATIENCE_S = 30.0
HOLDER = "qp.1"
REVOKED = {"fired": "admin", "former": "controller"}
ATTACKERS = ("otto", "rival", "eve", *REVOKED)


def attacked_laboratory(folder: Path, robot: str = "arm", hosts: Sequence[str] = ()) -> Path:
    """Certificates for a robot and all who shall attack it: also whom it does not list."""
    laboratory(folder, robot, hosts)
    issue(folder, "late", "admin", [], timedelta(seconds=-1))  # its certificate has expired
    for name, role in REVOKED.items():
        issue(folder, name, role, [], DAY)
    listed = (folder / robot / "access.yaml").read_text(encoding="utf-8")
    issue(folder, "eve", "admin", [], DAY)  # of the same authority, and on no list
    (folder / robot / "access.yaml").write_text(listed, encoding="utf-8")
    return folder


class Scene:
    """A robot on virtual time that follows a holder, and attackers who know all that it tells.

    With certificates the attackers are those whom the robot lists and yet gives no right, a second
    controller, somebody whom it does not list, and an admin and a controller who left the list
    while it ran.

    Args:
        place: `host:port` where the robot listens.
        certs: folder of the authority, with certificates.
        opened: opens the robot, given its endpoint and the folder.
    """

    def __init__(
        self, place: str, certs: Path | None, opened: Callable[..., Any] = AttackedRobot
    ) -> None:
        self.place = place
        self.threads = ThreadPoolExecutor()
        self.opened: list[Any] = []
        self._listed: tuple[Path, str] | None = None
        endpoint = f"{'tcp' if certs is None else 'tls'}/{place}"
        self.robot = self.keep(opened(endpoint, None if certs is None else str(certs)))
        self.now = self.robot.step()
        if certs is None:
            law = LinkSettings(connect=(endpoint,))
            foes = [("mallory", LinkSettings(connect=(endpoint,), mode="client"))]
        else:
            self._revoke(certs / "arm" / "access.yaml")
            law = client(certs, "qp", endpoint, "peer")
            foes = [  # who is closed again and again comes back as a peer
                (name, client(certs, name, endpoint, "peer" if name in REVOKED else "client"))
                for name in ATTACKERS
            ]
        self.holder = self.keep(ZenohControllerLink("arm", law, HOLDER, blocking=True))
        assert self.holder.presence.wait(PATIENCE_S)
        self.settings = [settings for _, settings in foes]
        self.tool = law.model_copy(update={"mode": "client"})
        self.foes = {
            session_name(settings, "1"): self.keep(open_session(settings, "arm"))
            for name, settings in foes
        }
        ring: Any = zenoh.handlers.RingChannel(4096)  # a queue that is full would block
        self.states = self.holder._session.declare_subscriber(key("arm", "state/2"), ring)

    def _revoke(self, file: Path) -> None:
        """Take names from the robot's list while it runs, as `hoap3 certs revoke` does."""
        listed = file.read_text(encoding="utf-8")
        assert all(self.robot.lets_in(name) for name in REVOKED)
        lines = [line for line in listed.splitlines() if line.removeprefix("- ") not in REVOKED]
        file.write_text("\n".join(lines), encoding="utf-8")
        self.wait(lambda: not any(self.robot.lets_in(name) for name in REVOKED))
        self._listed = file, listed

    def keep(self, one: Any) -> Any:
        self.opened.append(one)
        return one

    def step(self) -> None:
        self.now = self.robot.step()

    def wait(self, condition: Callable[[], Any]) -> Any:
        """Step until something is so."""
        end = time.monotonic() + PATIENCE_S
        while not (found := condition()):
            assert time.monotonic() < end
            self.step()
            os.sched_yield()
        return found

    def during(self, what: Callable[..., Any], *given: Any) -> Any:
        """The result of something that needs the robot to go on."""
        asked = self.threads.submit(what, *given)
        self.wait(asked.done)
        return asked.result()

    def follow(self) -> None:
        """Have the robot follow its holder."""
        self.wait(lambda: b'"granted": true' in (self.during(self.holder.ask, "acquire") or b""))
        self.wait(lambda: self.now.mode == State.ACTIVE)
        self.wait(lambda: self.holder._setpoint.matching_status.matching)

    def asks(self, verb: str, name: str = "", whom: Any = "ask", body: bytes = b"") -> bytes:
        """What all attackers are answered, in their own names, or in another."""
        answers = [
            self.during(ask, foe, "arm", verb, name or me, body, whom) or b""
            for me, foe in self.foes.items()
        ]
        return b"".join(answers)

    def put(self, leaf: str, payload: bytes) -> None:
        """All attackers publish; afterwards it has arrived, or never will."""
        for me, foe in self.foes.items():
            foe.put(key("arm", leaf.replace("{me}", me)), payload)
            self.during(ask, foe, "arm", "status", me)

    def close(self) -> None:
        for one in reversed(self.opened):
            one.close()
        self.threads.shutdown()
        if self._listed:  # for the next robot
            file, content = self._listed
            file.write_text(content, encoding="utf-8")
