"""`hoap3 service install`: checks the settings of a service and writes its systemd unit.

A unit has real-time rights, a watchdog, and few other rights.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hoap3.protocol import __version__
from hoap3.protocol.errors import ConfigError, UsageError
from hoap3.protocol.secure.credentials import KEY_FILE
from hoap3.protocol.secure.profile import profile
from hoap3.remote_controller.config import ControllerConfig
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.robots.urdf_import.source import absolute, is_source
from hoap3.robot_emulator.service import describe
from hoap3.tools.logs.files import whole_file
from hoap3.tools.services.configs import load_controller_config, load_emulator_config

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
SYSTEM = Path("/etc/systemd/system")
WATCHDOG_S = {"emulator": 10.0, "controller": 30.0}
"""Without a sign of life of the loop. A healthy loop takes less: a robot ticks, also at rest; a
controller that waits for its robot retries after 3 s, and answers of a robot may take 2 s. It is
more because an observer, which pings, may not run for seconds on a busy machine."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")
_USER = re.compile(r"[a-z_][a-z0-9_-]{0,31}")


def unit_text(
    name: str,
    description: str,
    command: Sequence[str],
    watchdog_s: float,
    *,
    user: str | None,
    of_user: bool,
    reads: Sequence[Path],
    writes: Path | None,
) -> str:
    """Return the whole file of a unit.

    Args:
        name: of the unit, and of its folders; without `.service`.
        description: one line.
        command: program and arguments, the program by its absolute path.
        watchdog_s: time without a sign of life of the loop after which it is restarted [s].
        user: that it runs as; None for one that systemd makes for it.
        of_user: whether it is a unit of a user's own systemd.
        reads: files and folders that it reads.
        writes: folder that it writes to, in addition to its own.
    """
    unit = [f"Description={_without_specifiers(description)}", "StartLimitIntervalSec=0"]
    service = [
        "Type=notify",
        "NotifyAccess=all",  # the observer tells
        f"ExecStart={' '.join(map(quoted, command))}",
        f"WatchdogSec={watchdog_s:g}",
        "WatchdogSignal=SIGKILL",  # a loop that hangs heeds no other
        f"TimeoutStartSec={START_S}",
        f"TimeoutStopSec={STOP_S}",
        "KillMode=mixed",  # SIGTERM is for the service: its observer ends after it
        "Restart=on-failure",
        f"RestartSec={RESTART_S}",
        f"StateDirectory={name}",
        f"CacheDirectory={name}",
        f"RuntimeDirectory={name}",
        "RuntimeDirectoryMode=0700",
        "RuntimeDirectoryPreserve=yes",  # it holds what was measured of this machine
        f"WorkingDirectory=%S/{name}",
        f"Environment=HOAP3_CACHE_DIR=%C/{name}/kernels",
        f"Environment=HOAP3_RUNTIME_DIR=%t/{name}/own",  # the one above may be a link
        "Environment=PYTHONUNBUFFERED=1",
        "LimitRTPRIO=99",
        "LimitMEMLOCK=infinity",
        "LimitNOFILE=4096",
        "LimitCORE=0",
    ]
    if of_user:
        hardening, target = HARDENING_OF_USERS, "default.target"
    else:  # a user's systemd has no target of the network
        unit += ["After=network-online.target time-sync.target", "Wants=network-online.target"]
        service.append(f"User={user}" if user else "DynamicUser=yes")
        if writes is not None:
            service.append(f"ReadWritePaths={quoted(str(writes)).replace('$$', '$')}")
        places = (*reads, *([writes] if writes else []))
        at_home = any(place.is_relative_to(home) for place in places for home in HOMES)
        hardening = HARDENING.format(home="read-only" if at_home else "yes")
        target = "multi-user.target"
    return (
        f"{MARK} of hoap3 {__version__}.\n\n"
        f"{_section('Unit', unit)}\n"
        f"{_section('Service', service)}\n{hardening}\n"
        f"{_section('Install', [f'WantedBy={target}'])}"
    )


def quoted(word: str) -> str:
    """A word of a command as systemd takes it: nothing in it is replaced."""
    safe = word.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("$", "$$")
    return safe if safe and not set(safe) & set(" \t'\";\\") else f'"{safe}"'


def _without_specifiers(text: str) -> str:
    """One line without specifiers."""
    return " ".join(text.split()).replace("%", "%%")


def _section(name: str, lines: Sequence[str]) -> str:
    return "\n".join([f"[{name}]", *lines]) + "\n"


@dataclass(frozen=True)
class Installed:
    """A unit that was written.

    Attributes:
        path: of its file.
        name: of the unit.
        command: that it runs.
        next: commands that have systemd start it.
    """

    path: Path
    name: str
    command: list[str]
    next: tuple[str, ...]


def install(
    side: str,
    config: str,
    overrides: list[str],
    *,
    out: Path | None = None,
    name: str | None = None,
    user: str | None = None,
    of_user: bool = False,
    secure: str | None = None,
) -> Installed:
    """Write the unit of an emulator or a controller.

    Args:
        side: "emulator" or "controller".
        config: as these commands take it; a path may be relative.
        overrides: `dotted.key=value`, each.
        out: folder for the unit; default: that of the system, or of the user.
        name: of the unit, default `hoap3-SIDE-CONFIG`.
        user: that the service runs as; default: a user that systemd makes.
        of_user: write it for this user's own systemd.
        secure: folder of its certificate; the same as `link.secure`.

    Raises:
        UsageError: a setting would be refused at the start, a name is not valid, another file has
            the unit's name, or a folder cannot be written.
    """
    if secure is not None:
        overrides = [*overrides, f"link.secure={json.dumps(str(Path(secure).absolute()))}"]
    read = load_emulator_config if side == "emulator" else load_controller_config
    settings, file = read(config, overrides)
    robot = describe(settings, file).name if isinstance(settings, EmulatorConfig) else None
    certificate = _checked_certificate(settings, robot, file, user=user, of_user=of_user)
    logs = Path(settings.log.directory)
    writes = logs if settings.log.record and logs.is_absolute() and not of_user else None
    if writes is not None:
        _check_logs(writes, file, user)
    if user is not None and (of_user or not _USER.fullmatch(user)):
        why = "is for a service of the system" if of_user else "is no name of a user"
        raise ConfigError("--as", "", user, why, "Leave --as or --user out, or name a user")
    name = name or f"hoap3-{side}-{re.sub(r'[^A-Za-z0-9_.-]', '-', Path(config).stem)}"
    if not _NAME.fullmatch(name):
        problem = "is no name of a unit"
        raise ConfigError("--name", "", name, problem, "Use letters, digits, `.`, `_` and `-`")
    program = _program()
    command = [str(program), side, _absolute(config)]
    for override in overrides:
        command += ["--set", override]
    text = unit_text(
        name,
        f"Robot emulator {robot}" if robot else f"Remote controller {config}",
        command,
        WATCHDOG_S[side],
        user=user,
        of_user=of_user,
        reads=(
            *(program, Path(sys.executable).resolve(), Path(sys.prefix), Path(file).resolve()),
            *([certificate] if certificate else []),
        ),
        writes=writes,
    )
    path = (out or _folder(of_user=of_user)) / f"{name}.service"
    _write(path, text)
    systemctl = "systemctl --user" if of_user else "sudo systemctl"
    link = [f"{systemctl} link {path.resolve()}"] if out else []
    start = f"{systemctl} enable --now {name}"
    return Installed(path, name, command, (*link, f"{systemctl} daemon-reload", start))


def _checked_certificate(
    settings: EmulatorConfig | ControllerConfig,
    robot: str | None,
    file: str,
    *,
    user: str | None,
    of_user: bool,
) -> Path | None:
    """The folder of the service's certificate, which it can use; None without one.

    Args:
        settings: of the service.
        robot: name of the robot that it is; None for a controller.
        file: where the settings stand.
        user, of_user: as for `install`.

    Raises:
        ConfigError: it cannot, or the folder could not be found or read by the service.
    """
    link = settings.link
    if link.secure is None:
        return None
    folder = Path(link.secure)
    if not folder.is_absolute():
        remedy = "Give --secure DIR, or the whole path"
        raise ConfigError(file, "link.secure", link.secure, "is found from here alone", remedy)
    places = ((), link.connect) if robot is None else (link.listen, ())
    role = profile(link.secure, robot or "", *places).credentials.role
    if robot is None and role != "controller":
        remedy = "Issue one: `hoap3 certs issue NAME --role controller`"
        raise ConfigError("--secure", "", str(folder), f"is of role {role}", remedy)
    if user is None and not of_user:
        problem = f"is missing: a user that systemd makes cannot read {folder / KEY_FILE}"
        raise ConfigError("--as", "", None, problem, "Name the owner of that file: --as USER")
    return folder


def _check_logs(folder: Path, file: str, user: str | None) -> None:
    """Check a folder of logs that is none of the service's own.

    Raises:
        ConfigError: the folder does not exist, or the service could not write there.
    """
    key = "log.directory"
    if not folder.is_dir():
        remedy = "Make it, and give it to the service's user"
        raise ConfigError(file, key, str(folder), "is no folder that exists", remedy)
    if user is None:
        problem = "cannot be written by a user that systemd makes"
        remedy = "Name who can: --as USER; or a place that does not begin with /: /var/lib has it"
        raise ConfigError(file, key, str(folder), problem, remedy)


def _program() -> Path:
    """`hoap3` beside the Python that runs this."""
    program = Path(sys.prefix) / "bin" / "hoap3"
    if not os.access(program, os.X_OK):
        raise UsageError(
            f"{program}: is no program. Install hoap3 with pip, and call it from there"
        )
    return program


def _absolute(config: str) -> str:
    """A path as a service finds it from any folder; a name stays one."""
    path = Path(config)
    if is_source(config):
        return absolute(config, Path())
    return str(path.resolve()) if path.exists() and ("/" in config or path.suffix) else config


def _folder(*, of_user: bool) -> Path:
    if not of_user:
        return SYSTEM
    home = os.environ.get("XDG_CONFIG_HOME", "")
    return (Path(home) if home.startswith("/") else Path.home() / ".config") / "systemd" / "user"


def _write(path: Path, text: str) -> None:
    try:
        there = path.read_text(encoding="utf-8", errors="replace") if path.exists() else MARK
        if path.is_symlink() or not there.startswith(MARK):
            raise UsageError(f"{path}: is there, and not ours. Choose another --name")
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as draft:
            draft.write_text(text, encoding="utf-8")
            draft.chmod(0o644)
    except OSError as error:
        problem = f"cannot be written: {error.strerror}"
        remedy = "Use sudo, or --user, or name a folder with --out"
        raise ConfigError(str(path), "", None, problem, remedy) from error
