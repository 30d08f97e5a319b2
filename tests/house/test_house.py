"""Rules of the whole code: import directions, light imports, public names, licences, data files."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest
from support import HOUSE
from support.longest_first import FIRST

MAY_IMPORT = {
    "protocol": ("hoap3.protocol",),
    "robot_emulator": ("hoap3.robot_emulator", "hoap3.protocol"),
    "remote_controller": ("hoap3.remote_controller", "hoap3.protocol"),
    "tools": ("hoap3.tools", "hoap3.remote_controller", "hoap3.robot_emulator", "hoap3.protocol"),
    "remote_controller/solvers": (
        *("hoap3.protocol.errors", "hoap3.protocol.runtime.numba_jit"),
        "hoap3.remote_controller.solvers",
    ),
}
"""What the files of a folder may import of the project: solvers know arrays only."""
ROOMS = [folder for folder in MAY_IMPORT if "/" not in folder]
SOURCES = [path for room in ROOMS for path in sorted((HOUSE / room).rglob("*.py"))]
TESTS = sorted((HOUSE / "tests").rglob("*.py"))


def imported(path: Path) -> set[str]:
    """Every module that a file imports, wherever in it."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
    return found


@pytest.mark.parametrize("folder", MAY_IMPORT)
def test_imports_go_one_way(folder):
    beside = {path.name for path in HOUSE.iterdir() if path.is_dir()} - {"hoap3"}
    for path in (HOUSE / folder).rglob("*.py"):
        names = imported(path)
        assert not {name.partition(".")[0] for name in names} & beside, path  # nor tests
        ours = {f"{name}." for name in names if name.partition(".")[0] == "hoap3"}
        allowed = tuple(f"{module}." for module in MAY_IMPORT[folder])
        assert all(name.startswith(allowed) for name in ours), path


PAGES = [HOUSE / "CONTRIBUTING.md", HOUSE / "docs" / "internals" / "decisions.md"]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_for_those_who_change_the_code_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        path = link.partition("#")[0]
        assert link.startswith("https://") or (page.parent / path).exists(), link


def test_files_stay_within_600_lines():
    for path in SOURCES + TESTS:
        assert len(path.read_text(encoding="utf-8").splitlines()) <= 600, path


@pytest.mark.parametrize(
    ("module", "absent"),
    [
        ("hoap3", ("pinocchio", "numba", "zenoh", "matplotlib")),
        ("hoap3.protocol", ("pinocchio", "numba", "zenoh")),
        ("hoap3.protocol.messages", ("pinocchio", "numba", "zenoh")),
        ("hoap3.remote_controller.solvers", ("zenoh", "pinocchio")),
        ("hoap3.remote_controller.config", ("numba", "zenoh", "pinocchio")),
        ("hoap3.robot_emulator.service", ("numba", "zenoh", "pinocchio")),
        ("hoap3.tools.cli.app", ("numba", "zenoh", "pinocchio", "pydantic")),
    ],
)
def test_importing_stays_light(module, absent):
    code = f"import sys, {module}; print(*[name for name in {absent!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


@pytest.mark.parametrize(
    "command", [("--help",), ("--version",), ("list",), ("config", "keys", "qp12")]
)
def test_a_command_that_computes_nothing_loads_nothing_heavy(command):
    code = """if True:
        import contextlib, io, sys
        from hoap3.tools.cli.app import main
        with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
            main()
        print(*{"numba", "pinocchio", "zenoh", "matplotlib"} & set(sys.modules))
    """
    words = [sys.executable, "-c", code, *command]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_references_run_without_numba():
    files = [path for path in SOURCES if path.stem.endswith(("_oracle", "_reference"))]
    names = [path.relative_to(HOUSE).with_suffix("").parts for path in files]
    modules = sorted(".".join(("hoap3", *parts)) for parts in names)
    code = f"import sys, {', '.join(modules)}; assert 'numba' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_front_door_has_every_error_and_opens_on_all_that_it_names():
    import hoap3
    from hoap3.protocol import errors

    ours = {name for name, each in vars(errors).items() if isinstance(each, type)}
    assert {name for name in ours if name.endswith("Error")} <= set(hoap3.__all__)
    named = {"Controller", "Environment", "VelocityController", "Settings", "RobotDescription"}
    assert named <= set(dir(hoap3))
    assert "Environment" not in hoap3.__all__  # import * must work without its extra
    assert all(getattr(hoap3, name) is not None for name in hoap3.__all__)
    with pytest.raises(AttributeError, match="no_such_name"):
        hoap3.no_such_name  # noqa: B018


def test_the_public_interface_stays_put():
    from hoap3 import load_robot as load
    from hoap3 import simulate, solvers

    assert set(solvers.__all__) == {
        *("Ghc", "Pinv", "Qp12", "SdpGains", "StableQp", "hqp", "weighted"),
    }
    assert simulate.__annotations__.keys() >= {"robot", "controller", "duration", "seed"}
    assert load("hoap3").name == "hoap3"


def required(name: str, seen: set[str]) -> set[str]:
    """A distribution and everything that it needs at run time."""
    key = re.sub(r"[-_.]+", "-", name).lower()
    if key in seen:
        return seen
    seen.add(key)
    try:
        needs = metadata.requires(name) or []
    except metadata.PackageNotFoundError:
        return seen  # for another platform or Python
    for need in needs:
        if "extra ==" not in need:
            required(re.split(r"[ ;<>=!~\[(]", need, maxsplit=1)[0], seen)
    return seen


def test_nothing_is_gpl_at_run_time():
    names = required("hoap3", set()) - {"hoap3"}
    assert {"numpy", "pin", "eclipse-zenoh", "numba"} <= names
    for name in sorted(names):
        try:
            facts = metadata.metadata(name)
        except metadata.PackageNotFoundError:
            continue
        licences = [facts.get("License-Expression") or ""]
        licences += [line for line in facts.get_all("Classifier") or [] if "License" in line]
        licences.append((facts.get("License") or "").split("\n")[0][:100])
        text = " ".join(licences)
        gpl = re.search(r"(?<![LA-Z])A?GPL|General Public License", text)
        assert not gpl or "Lesser" in text, (name, text)


def test_the_wheel_is_told_of_every_data_file():
    import tomllib

    listed = tomllib.loads((HOUSE / "pyproject.toml").read_text(encoding="utf-8"))
    patterns = listed["tool"]["setuptools"]["package-data"]
    for room in ROOMS:
        ours = patterns.get(f"hoap3.{room}", [])
        known = {path for pattern in ours for path in (HOUSE / room).glob(pattern)}
        files = [path for path in (HOUSE / room).rglob("*") if path.is_file()]
        assert {path for path in files if path.suffix not in {".py", ".pyc"}} <= known, room


def test_no_two_helpers_of_the_tests_have_one_name():
    """Tests import them by their bare names: of two, one worker of pytest may get the other.

    Modules of a package are imported by their full names.
    """
    helpers = [path for path in (HOUSE / "tests").rglob("*.py") if path.name != "conftest.py"]
    names = [path.name for path in helpers if not (path.parent / "__init__.py").exists()]
    assert sorted(names) == sorted(set(names))


@pytest.mark.parametrize("start", FIRST)
def test_what_begins_is_there(start):
    assert (HOUSE / start).exists()
