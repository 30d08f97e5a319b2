"""The text of a systemd unit: real-time rights, a watchdog, and as little else as will do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hoap3.protocol import __version__

MARK = "# Written by `hoap3 service install`"
START_S = 600  # the first start on a machine compiles the kernels
STOP_S = 90  # the robot brakes, and the observer writes what is left
RESTART_S = 5  # whatever ended it: a port or a disk may be free, a clock right by then
HOMES = (Path("/home"), Path("/root"))

HARDENING = """\
NoNewPrivileges=yes
CapabilityBoundingSet=
AmbientCapabilities=
ProtectSystem=strict
ProtectHome={home}
PrivateTmp=yes
PrivateDevices=yes
DevicePolicy=closed
ProtectClock=yes
ProtectControlGroups=yes
ProtectHostname=yes
ProtectKernelLogs=yes
ProtectKernelModules=yes
ProtectKernelTunables=yes
ProtectProc=invisible
KeyringMode=private
RemoveIPC=yes
RestrictAddressFamilies=AF_INET AF_INET6 AF_UNIX AF_NETLINK
RestrictNamespaces=yes
RestrictSUIDSGID=yes
LockPersonality=yes
SystemCallArchitectures=native
SystemCallFilter=@system-service
SystemCallFilter=~@privileged
SystemCallErrorNumber=EPERM
UMask=0077
"""
"""What a service of the system may not do. It may take real-time priority, and it may write memory
that is executed: numba compiles."""

HARDENING_OF_USERS = """\
NoNewPrivileges=yes
LockPersonality=yes
RestrictAddressFamilies=AF_INET AF_INET6 AF_UNIX AF_NETLINK
RestrictSUIDSGID=yes
SystemCallArchitectures=native
UMask=0077
"""
"""The part of it that a user's own systemd can grant."""


@dataclass(frozen=True)
class Unit:
    """One service as systemd shall run it.

    Attributes:
        name: of the unit, and of its folders; without `.service`.
        description: one line.
        command: program and arguments, the program by its absolute path.
        watchdog_s: time without a sign of life of the loop after which it is restarted [s].
        user: whom it runs as; None for one that systemd makes for it.
        of_user: whether it is a unit of a user's own systemd.
        reads: files and folders that it reads.
        writes: folders that it writes to, beside its own.
    """

    name: str
    description: str
    command: Sequence[str]
    watchdog_s: float
    user: str | None = None
    of_user: bool = False
    reads: Sequence[Path] = ()
    writes: Sequence[Path] = ()

    @property
    def text(self) -> str:
        """The whole file."""
        return f"{MARK} of hoap3 {__version__}.\n\n{self._unit}\n{self._service}\n{self._install}"

    @property
    def _unit(self) -> str:
        lines = [f"Description={_plain(self.description)}", "StartLimitIntervalSec=0"]
        if not self.of_user:  # a user's systemd has no such target
            lines += ["After=network-online.target time-sync.target", "Wants=network-online.target"]
        return _section("Unit", lines)

    @property
    def _service(self) -> str:
        lines = [
            "Type=notify",
            "NotifyAccess=all",  # the observer tells
            f"ExecStart={' '.join(map(quoted, self.command))}",
            f"WatchdogSec={self.watchdog_s:g}",
            "WatchdogSignal=SIGKILL",  # a loop that hangs heeds no other
            f"TimeoutStartSec={START_S}",
            f"TimeoutStopSec={STOP_S}",
            "KillMode=mixed",  # SIGTERM is for the service: its observer ends after it
            "Restart=on-failure",
            f"RestartSec={RESTART_S}",
            f"StateDirectory={self.name}",
            f"CacheDirectory={self.name}",
            f"RuntimeDirectory={self.name}",
            "RuntimeDirectoryMode=0700",
            "RuntimeDirectoryPreserve=yes",  # it holds what was measured of this machine
            f"WorkingDirectory=%S/{self.name}",
            f"Environment=HOAP3_CACHE_DIR=%C/{self.name}/kernels",
            f"Environment=HOAP3_RUNTIME_DIR=%t/{self.name}/own",  # the one above may be a link
            "Environment=PYTHONUNBUFFERED=1",
            "LimitRTPRIO=99",
            "LimitMEMLOCK=infinity",
            "LimitNOFILE=4096",
            "LimitCORE=0",
        ]
        if self.of_user:
            hardening = HARDENING_OF_USERS
        else:
            lines.append(f"User={self.user}" if self.user else "DynamicUser=yes")
            folders = (quoted(str(folder)).replace("$$", "$") for folder in self.writes)
            lines += [f"ReadWritePaths={folder}" for folder in folders]
            hardening = HARDENING.format(home="read-only" if self._at_home else "yes")
        return _section("Service", lines) + "\n" + hardening

    @property
    def _install(self) -> str:
        target = "default.target" if self.of_user else "multi-user.target"
        return _section("Install", [f"WantedBy={target}"])

    @property
    def _at_home(self) -> bool:
        return any(
            path.is_relative_to(home) for path in (*self.reads, *self.writes) for home in HOMES
        )


def quoted(word: str) -> str:
    """A word of a command as systemd takes it: nothing in it is replaced."""
    safe = word.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("$", "$$")
    return safe if safe and not set(safe) & set(" \t'\";\\") else f'"{safe}"'


def _plain(text: str) -> str:
    """One line without specifiers."""
    return " ".join(text.split()).replace("%", "%%")


def _section(name: str, lines: Sequence[str]) -> str:
    return "\n".join([f"[{name}]", *lines]) + "\n"
