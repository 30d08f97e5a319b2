"""The rules that the whole house keeps: imports go down, files stay short, nothing is GPL."""

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
    "protocol": {"protocol"},
    "robot_emulator": {"robot_emulator", "protocol"},
    "remote_controller": {"remote_controller", "protocol"},
    "tools": {"tools", "remote_controller", "robot_emulator", "protocol"},
}
SOURCES = [path for room in MAY_IMPORT for path in sorted((HOUSE / room).rglob("*.py"))]
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


def test_imports_only_go_down():
    for path in SOURCES:
        room = path.relative_to(HOUSE).parts[0]
        names = [name.split(".") for name in imported(path)]
        assert not {name[0] for name in names} & set(MAY_IMPORT), path  # always as `hoap3.…`
        assert {name[1] for name in names if name[0] == "hoap3"} <= MAY_IMPORT[room], path


PACKAGES = {
    "protocol": (("config",), ("runtime", "secure"), ("link", "robot")),
    "robot_emulator": (("robots",), ("plants",), ("filters",)),
    "remote_controller": (
        ("model", "references", "scheduling", "solvers"),
        ("constraints", "tasks"),
        ("controllers",),
    ),
    "tools": (
        ("machine", "logs", "html"),
        ("show", "timing", "verify", "picture", "certs"),
        ("services", "bench", "environment", "report"),
        (
            "beside",
            "bridge",
            "compare",
            "doctor",
            "latency",
            "new",
            "reproduce",
            "robots",
            "soak",
            "testing",
            "view",
        ),
        ("cli",),
    ),
}
"""The packages of each room, level by level: each imports only what stands before it."""

BELOW = {
    "protocol": {"description", "errors", "messages", "wire_versions"},
    "robot_emulator": {"config"},
    "remote_controller": {"default_task"},
    "tools": {"replay", "simulate"},
}
"""Modules beside the packages of a room that these may import."""


@pytest.mark.parametrize("room", PACKAGES)
def test_packages_of_a_room_import_only_those_of_lower_levels(room):
    levels = PACKAGES[room]
    assert len(levels) <= 5
    assert {name for level in levels for name in level} == {
        path.parent.name for path in (HOUSE / room).glob("*/__init__.py")
    }
    for number, level in enumerate(levels):
        allowed = BELOW[room] | {name for lower in levels[:number] for name in lower}
        for package in level:
            for path in (HOUSE / room / package).rglob("*.py"):
                names = [name.split(".") for name in imported(path)]
                used = {name[2] for name in names if name[:2] == ["hoap3", room] and name[2:]}
                assert used <= allowed | {package}, path


def test_the_architecture_page_names_every_package_in_its_order():
    page = (HOUSE / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = page[page.index("## Packages") : page.index("## Where to look")]
    shown = re.findall(r"^\|[^|]*\| `(\w+)` \|", table, flags=re.MULTILINE)
    levels = [level for room in PACKAGES.values() for level in room]
    for level in levels:
        here, shown = shown[: len(level)], shown[len(level) :]
        assert set(here) == set(level)
    assert not shown


PAGES = [HOUSE / "CONTRIBUTING.md", *sorted((HOUSE / "docs" / "decisions").glob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_for_those_who_change_the_code_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        path = link.partition("#")[0]
        assert link.startswith("https://") or (page.parent / path).exists(), link


def test_every_decision_is_listed():
    listed = (HOUSE / "docs" / "decisions" / "README.md").read_text(encoding="utf-8")
    assert all(f"({page.name})" in listed for page in PAGES[1:] if page.name != "README.md")


def test_no_folder_holds_more_than_15_files():
    for folder in {path.parent for path in (*SOURCES, *TESTS)}:
        assert len(list(folder.glob("*.py"))) <= 15, folder


def test_solvers_know_arrays_only():
    allowed = (
        "hoap3.protocol.errors",
        "hoap3.protocol.runtime.numba_jit",
        "hoap3.remote_controller.solvers",
    )
    for path in sorted((HOUSE / "remote_controller" / "solvers").rglob("*.py")):
        ours = {name for name in imported(path) if name.split(".")[0] == "hoap3"}
        assert all(name.startswith(allowed) for name in ours), path


def test_only_its_own_modules_import_zenoh_and_pinocchio():
    for path in SOURCES:
        names = {name.split(".")[0] for name in imported(path)}
        where = str(path.relative_to(HOUSE))
        if "zenoh" in names:
            assert where in {"protocol/link/zenoh_session.py", "tools/services/record.py"}
        if "pinocchio" in names:
            assert where in {
                "protocol/robot/pinocchio_model.py",
                "protocol/robot/rigid_body_dynamics.py",
                "remote_controller/model/frame_dynamics.py",
                "remote_controller/model/free_dynamics.py",
                "remote_controller/model/kinematics.py",
                "remote_controller/service.py",
                "tools/reproduce/papers/qp12/oracle.py",
                "tools/verify/controllers/acceleration/free_base.py",
                "tools/verify/robot.py",
                "tools/view/picture/geometry.py",
                "tools/view/picture/kinematics.py",
            }


@pytest.mark.parametrize("path", SOURCES + TESTS, ids=lambda path: str(path.relative_to(HOUSE)))
def test_files_stay_within_600_lines(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 600


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


def test_the_front_door_has_every_error_and_opens_on_all_that_it_names():
    import hoap3
    from hoap3.protocol import errors

    ours = {name for name, each in vars(errors).items() if isinstance(each, type)}
    assert {name for name in ours if name.endswith("Error")} <= set(hoap3.__all__)
    assert {"Controller", "VelocityController", "Settings", "RobotDescription"} <= set(dir(hoap3))
    assert all(getattr(hoap3, name) is not None for name in hoap3.__all__)
    with pytest.raises(AttributeError, match="no_such_name"):
        hoap3.no_such_name  # noqa: B018


def test_the_public_interface_stays_put():
    from hoap3 import load_robot as load
    from hoap3 import simulate, solvers

    assert set(solvers.__all__) == {
        *("BoundedQp12", "DescentRate", "LpNorm", "Pinv", "Qp12", "StableQp"),
        *("feasible_rate", "lp_norm", "lyapunov_qp", "pinv", "pinv_plain", "qp12", "qp12_bounded"),
        *("Ghc", "generalized_projector", "ghc", "hqp"),
        *("SdpGains", "sdp_gains", "weighted"),
    }
    bounds = {"lower", "upper"}
    assert solvers.qp12_bounded.__annotations__.keys() >= {"gradient", "decrease", "gamma", *bounds}
    assert solvers.lyapunov_qp.__annotations__.keys() >= {"gamma", "A", "b", *bounds}
    assert solvers.feasible_rate.__annotations__.keys() >= {"gradient", "psi", "A", "b", *bounds}
    assert solvers.qp12.__annotations__.keys() >= {"gradient", "decrease", "gamma", "out"}
    assert solvers.generalized_projector.__annotations__.keys() >= {"alpha_rows", "jacobian"}
    tasks = {"jacobians", "targets", "alpha", "M", "bias", "w_r", "regularise"}
    limits = {"qdd_lower", "qdd_upper", "tau_lower", "tau_upper"}
    assert solvers.ghc.__annotations__.keys() >= tasks | limits
    gains = {"jacobians", "errors", "dt", "dq_lower", "dq_upper", "beta_desired", "delta"}
    assert solvers.sdp_gains.__annotations__.keys() >= gains | {"weights"}
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
        assert (
            not re.search(r"(?<![LA-Z])A?GPL|General Public License", text) or "Lesser" in text
        ), (
            name,
            text,
        )


def test_the_wheel_is_told_of_every_data_file():
    import tomllib

    listed = tomllib.loads((HOUSE / "pyproject.toml").read_text(encoding="utf-8"))
    patterns = listed["tool"]["setuptools"]["package-data"]
    for room in MAY_IMPORT:
        known = {
            path
            for pattern in patterns.get(f"hoap3.{room}", [])
            for path in (HOUSE / room).glob(pattern)
        }
        data = {
            path
            for path in (HOUSE / room).rglob("*")
            if path.is_file() and path.suffix not in {".py", ".pyc"}
        }
        assert data <= known, room


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


def test_tests_of_a_room_stand_in_folders_of_its_packages():
    for path in TESTS:
        room, *packages = path.parent.relative_to(HOUSE / "tests").parts or ["support"]
        if room in MAY_IMPORT:
            assert (HOUSE / room).joinpath(*packages).is_dir(), path
        else:
            assert room in {"docs", "frozen", "fuzz", "house", "proofs", "support", "system"}, path
