"""`hoap3 service install`: checks the settings of a service, then writes its unit."""

from __future__ import annotations

import json
import os
import re
import sys
from dataclasses import dataclass
from pathlib import Path

from hoap3.protocol.config.settings import LogSettings
from hoap3.protocol.errors import ConfigError, UsageError
from hoap3.protocol.secure.credentials import KEY_FILE
from hoap3.protocol.secure.profile import profile
from hoap3.remote_controller.config import ControllerConfig
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.robots.urdf_import.source import absolute, is_source
from hoap3.robot_emulator.service import describe
from hoap3.tools.logs.atomic_write import whole_file
from hoap3.tools.services.services import controller_config, emulator_config
from hoap3.tools.services.units.unit import MARK, Unit

SYSTEM = Path("/etc/systemd/system")
WATCHDOG_S = {"emulator": 10.0, "controller": 30.0}
LEAST_WATCHDOG_S = {"emulator": 2.0, "controller": 15.0}
"""What a loop that is well may take between two signs of life: a robot ticks, also at rest; a
controller that waits for its robot asks again after 3 s, and answers of a robot may take 2 s. By
default it is more: an observer has no urgency, and on a busy machine it may not run for seconds."""
LONGEST_WATCHDOG_S = 3600.0
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")
_USER = re.compile(r"[a-z_][a-z0-9_-]{0,31}")


@dataclass(frozen=True)
class Installed:
    """A unit that was written.

    Attributes:
        path: of its file.
        unit: what it says.
        next: commands that have systemd start it.
    """

    path: Path
    unit: Unit
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
    watchdog_s: float | None = None,
    secure: str | None = None,
) -> Installed:
    """Write the unit of an emulator or a controller.

    Args:
        side: "emulator" or "controller".
        config: as these commands take it; a path may be relative.
        overrides: `dotted.key=value`, each.
        out: folder for the unit; default: that of the system, or of the user.
        name: of the unit, default `hoap3-SIDE-CONFIG`.
        user: whom the service runs as; default: a user that systemd makes.
        of_user: write it for this user's own systemd.
        watchdog_s: time without a sign of life [s]; default: `WATCHDOG_S`.
        secure: folder of its certificate; the same as `link.secure`.

    Raises:
        UsageError: a setting would be refused at the start, a name will not do, another file has
            the unit's name, or a folder cannot be written.
    """
    if secure is not None:
        overrides = [*overrides, f"link.secure={json.dumps(str(Path(secure).absolute()))}"]
    settings, file = _settings(side, config, overrides)
    robot = describe(settings, file).name if isinstance(settings, EmulatorConfig) else None
    certificate = _checked_certificate(settings, robot, file, user=user, of_user=of_user)
    writes = [
        folder
        for key, place in _places(settings.log).items()
        if (folder := _checked_place(key, place, file, user=user, of_user=of_user)) is not None
    ]
    watchdog_s = WATCHDOG_S[side] if watchdog_s is None else watchdog_s
    least = LEAST_WATCHDOG_S[side]
    if not least <= watchdog_s <= LONGEST_WATCHDOG_S:
        remedy = f"Give {least:g} to {LONGEST_WATCHDOG_S:g} s, a healthy loop may take that"
        raise ConfigError("--watchdog", "", watchdog_s, "is no time for this service", remedy)
    if user is not None and (of_user or not _USER.fullmatch(user)):
        why = "is for a service of the system" if of_user else "is no name of a user"
        raise ConfigError("--as", "", user, why, "Leave --as or --user out, or name a user")
    name = name or f"hoap3-{side}-{_plain(Path(config).stem)}"
    if not _NAME.fullmatch(name):
        problem = "is no name of a unit"
        raise ConfigError("--name", "", name, problem, "Use letters, digits, `.`, `_` and `-`")
    program = _program()
    words = [str(program), side, _absolute(config)]
    for override in overrides:
        words += ["--set", override]
    unit = Unit(
        name=name,
        description=f"Robot emulator {robot}" if robot else f"Remote controller {config}",
        command=words,
        watchdog_s=watchdog_s,
        user=user,
        of_user=of_user,
        reads=(
            *(program, Path(sys.executable).resolve(), Path(sys.prefix), Path(file).resolve()),
            *([certificate] if certificate else []),
        ),
        writes=tuple(dict.fromkeys(writes)),
    )
    path = (out or _folder(of_user=of_user)) / f"{name}.service"
    _write(path, unit.text)
    systemctl = "systemctl --user" if of_user else "sudo systemctl"
    link = [f"{systemctl} link {path.resolve()}"] if out else []
    start = f"{systemctl} enable --now {name}"
    return Installed(path, unit, (*link, f"{systemctl} daemon-reload", start))


def _settings(
    side: str, config: str, overrides: list[str]
) -> tuple[EmulatorConfig | ControllerConfig, str]:
    """What the service will read, checked as at its start, and where that stands."""
    read = emulator_config if side == "emulator" else controller_config
    return read(config, overrides)


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


def _places(log: LogSettings) -> dict[str, Path]:
    """Folders that a service writes to, by the key that names them."""
    found = {}
    if log.record:
        found["log.directory"] = Path(log.directory)
    if log.json_lines is not None:
        found["log.json_lines"] = Path(log.json_lines).parent
    return found


def _checked_place(
    key: str, folder: Path, file: str, *, user: str | None, of_user: bool
) -> Path | None:
    """A folder that a service writes to where that is none of its own; else None.

    Raises:
        ConfigError: the folder is not there, or the service could not write there.
    """
    if of_user or not folder.is_absolute():
        return None
    if not folder.is_dir():
        remedy = "Make it, and give it to the service's user"
        raise ConfigError(file, key, str(folder), "is no folder that there is", remedy)
    if user is None:
        problem = "cannot be written by a user that systemd makes"
        remedy = "Name who can: --as USER; or a place that does not begin with /: /var/lib has it"
        raise ConfigError(file, key, str(folder), problem, remedy)
    return folder


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


def _plain(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.-]", "-", text)


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
