"""Writes a package of one's own to begin with: sources, config, tests, entry point."""

from __future__ import annotations

import importlib.util
import keyword
import re
import shlex
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from string import Template

from hoap3.protocol.errors import ConfigError, UsageError, one_of
from hoap3.tools.new.kinds import KINDS, Kind

NAME = re.compile(r"[a-z][a-z0-9_]{0,31}")
WHERE = "hoap3 new"


@dataclass(frozen=True)
class Written:
    """What was written.

    Attributes:
        folder: of the package.
        files: paths in it.
        next: commands that install, test and run it, from where `hoap3 new` was called.
    """

    folder: Path
    files: tuple[str, ...]
    next: tuple[str, str, str]


def write_package(kind: str, name: str, out: Path | None = None) -> Written:
    """Write the package of a new controller, task, constraint, robot or plant.

    Args:
        kind: a key of `KINDS`.
        name: what it is registered as, and the name of its module.
        out: the folder to make; by default one of that name, here.

    Raises:
        ConfigError: there is no such kind, or the name will not do.
        UsageError: the folder is there already, or cannot be written.
    """
    contents = render(kind, name)
    _check_free(KINDS[kind], kind, name)
    folder = out or Path(name)
    try:
        if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
            raise UsageError(f"{folder} is there already. Name another folder with --out")
        for path, text in contents.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            with (folder / path).open("x", encoding="utf-8") as file:
                file.write(text)
    except OSError as error:
        problem = f"{folder} cannot be written: {error.strerror}"
        raise UsageError(f"{problem}. Name another folder with --out") from error
    install = f"cd {shlex.quote(str(folder))} && pip install -e '.[test]'"
    commands = (install, "python -m pytest", _words(kind, name)["run"])
    return Written(folder, tuple(contents), commands)


def render(kind: str, name: str) -> dict[str, str]:
    """Content of every file of a package, by its path.

    Raises:
        ConfigError: there is no such kind, or the name is none that Python and hoap3 can take.
    """
    if kind not in KINDS:
        raise ConfigError(WHERE, "KIND", kind, "is unknown", one_of(kind, KINDS, "Known"))
    if not NAME.fullmatch(name):
        remedy = "Write a to z first, then at most 31 of a to z, 0 to 9 and _"
        raise ConfigError(WHERE, "NAME", name, "cannot be the name of a module", remedy)
    known, words = KINDS[kind], _words(kind, name)
    sources = {path: _template(template) for path, template in known.files.items()}
    code = " ".join(text for path, text in sources.items() if path.endswith(".py"))
    used = set(re.findall(r"\w+", code))
    reserved = any(map(keyword.iskeyword, (name, words["Class"])))
    if reserved or words["Class"] in used:
        problem = f"would make a class {words['Class']}, which means something else there"
        raise ConfigError(WHERE, "NAME", name, problem, "Choose another one")
    return {
        Template(path).substitute(words): Template(text).substitute(words)
        for path, text in sources.items()
    }


def _check_free(known: Kind, kind: str, name: str) -> None:
    """Refuse a name that something else has.

    Raises:
        ConfigError: there is a class, a config, a robot or a module of that name.
    """
    if name in known.taken():
        problem = f"is the name of a {kind}, or of a config, that there is already"
    elif importlib.util.find_spec(name) is not None:
        problem = "is the name of a module that Python finds already"
    else:
        return
    raise ConfigError(WHERE, "NAME", name, problem, "Choose another one")


def _words(kind: str, name: str) -> dict[str, str]:
    """What stands for each word of the templates."""
    known = KINDS[kind]
    camel = "".join(part.capitalize() for part in name.split("_"))
    words = {
        "name": name,
        "kind": kind,
        "dist": name.replace("_", "-").rstrip("-"),
        "Class": camel if camel.endswith(known.ending) else camel + known.ending,
        "what": known.what,
    }
    for key in ("entry", "source", "modules"):
        words[key] = Template(getattr(known, key)).substitute(words)
    words["run"] = f"hoap3 run --lockstep {Template(known.run).substitute(words)}"
    return words


def _template(name: str) -> str:
    file = resources.files("hoap3.tools.new") / "templates" / f"{name}.txt"
    return file.read_text(encoding="utf-8")
