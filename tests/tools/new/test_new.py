"""Packages that `hoap3 new` begins: whole, found by their names, and moving at once."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from support import HOUSE
from support.command_bench import inside

import hoap3
from hoap3.protocol.config.settings import load_yaml
from hoap3.protocol.errors import ConfigError, UsageError
from hoap3.remote_controller.constraints.registry import find as find_constraint
from hoap3.remote_controller.registry import find as find_controller
from hoap3.remote_controller.tasks.registry import find as find_task
from hoap3.robot_emulator.plants.registry import PLANTS
from hoap3.tools.new.kinds import KINDS
from hoap3.tools.new.package import render, write_package
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.statements import check_engagements

FIND = {
    "controller": find_controller,
    "task": find_task,
    "constraint": find_constraint,
    "robot": hoap3.load_robot,
    "plant": PLANTS.find,
}
every_kind = pytest.mark.parametrize("kind", KINDS)


def declared(folder: Path, site: Path) -> None:
    """What pip leaves behind of a package, as far as its name and entry points are concerned."""
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    facts = site / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    facts.mkdir(parents=True)
    (facts / "METADATA").write_text(f"Name: {project['name']}\nVersion: {project['version']}\n")
    (facts / "entry_points.txt").write_text(
        "".join(
            f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in points.items())
            for group, points in project["entry-points"].items()
        )
    )


@pytest.fixture
def begun(tmp_path, monkeypatch):
    """Writes a package called `first_try`, and has it found as an installed one is."""
    monkeypatch.setattr(sys, "path", list(sys.path))

    def begin(kind: str) -> Path:
        written = write_package(kind, "first_try", tmp_path / "package")
        declared(written.folder, tmp_path / "site")
        sys.path[:0] = [str(tmp_path / "site"), str(written.folder / "src")]
        return written.folder

    yield begin
    sys.modules.pop("first_try", None)


@every_kind
def test_it_is_found_by_its_name_and_moves(kind, begun):
    folder = begun(kind)
    assert FIND[kind]("first_try") is not None
    config = str(folder / "first_try.yaml")
    assert inside("config", "check", config).code == 0
    if kind in {"robot", "plant"}:
        run = hoap3.simulate(config, "qp12", duration=0.1)
    else:
        run = hoap3.simulate("ur5" if kind == "task" else "hoap3", config, duration=0.1)
    reference = run.states["reference"]
    assert np.abs(reference[-1] - reference[0]).max() > 1e-4
    assert run.deadlines.run_rate == 1.0


def test_answers_of_an_installed_controller_are_verified(begun):
    config = begun("controller") / "first_try.yaml"
    run, claims = hoap3.simulate("hoap3", str(config), duration=0.1), Claims()
    check_engagements(run.records, "first_try", load_yaml(config)["parameters"], claims)
    assert claims.counts["optimum"].checked >= 100
    assert claims.false == claims.unverifiable == 0


@every_kind
def test_every_file_is_whole(kind, tmp_path):
    written = write_package(kind, "first_try", tmp_path / "package")
    found = {str(path.relative_to(written.folder)) for path in written.folder.rglob("*.*")}
    assert found == set(written.files)
    assert {"pyproject.toml", "README.md", "first_try.yaml", "tests/test_first_try.py"} <= found
    for file in written.files:
        text = (written.folder / file).read_text(encoding="utf-8")
        assert "$" not in text
        if file.endswith(".py"):
            compile(text, file, "exec")


@every_kind
def test_what_is_there_is_not_overwritten(kind, tmp_path):
    folder = tmp_path / "mine"
    folder.mkdir()
    write_package(kind, "first_try", folder)  # an empty folder will do
    before = {path: path.read_bytes() for path in folder.rglob("*.*")}
    (tmp_path / "file").write_text("mine")
    for taken in (folder, tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(UsageError):
            write_package(kind, "second_try", taken)
    assert before == {path: path.read_bytes() for path in folder.rglob("*.*")}
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        *(("controller", name) for name in ("qp12", "qp12_paper", "json", "numpy")),
        *(("robot", name) for name in ("ur5", "hoap3_standing")),
        ("constraint", "viability"),
        ("plant", "mujoco"),
        ("plant", "declared"),  # a class that the plant uses
        *(("task", name) for name in ("com", "hoap3", "class", "none", "My_task", "my-task")),
        *(("task", name) for name in ("1st", "", "a/b", "a" * 33, "überall")),
    ],
)
def test_a_name_that_will_not_do_is_refused_and_nothing_is_written(
    kind, name, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError) as found:
        write_package(kind, name)
    assert (found.value.file, found.value.key) == ("hoap3 new", "NAME")
    assert not list(tmp_path.iterdir())


def test_a_kind_that_there_is_not_has_the_nearest_one(tmp_path):
    with pytest.raises(ConfigError, match="controller"):
        write_package("controler", "first_try", tmp_path / "package")


@every_kind
@pytest.mark.parametrize("name", ["a", "x_", "a_b_2", "first_controller"])
def test_a_class_is_called_as_its_package(kind, name):
    texts = render(kind, name)
    camel = {"a": "A", "x_": "X", "a_b_2": "AB2", "first_controller": "FirstController"}[name]
    ending = "Controller" if kind == "controller" and not camel.endswith("Controller") else ""
    if kind != "robot":
        assert f"class {camel}{ending}(" in texts[f"src/{name}.py"]
    assert f"class Test{camel}{ending}(" in texts[f"tests/test_{name}.py"]
    project = tomllib.loads(texts["pyproject.toml"])
    ((group, points),) = project["project"]["entry-points"].items()
    assert group == f"hoap3.{kind}s"
    assert list(points) == [name]


def test_the_command_says_what_comes_next(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = inside("new", "plant", "first_try", "--out", "my packages/one")
    assert done.code == 0, done.stderr
    *_, install, test, run = done.stdout.splitlines()
    assert install.split()[:4] == ["cd", "'my", "packages/one'", "&&"]
    assert test.split() == ["python", "-m", "pytest"]
    assert run.split()[:3] == ["hoap3", "run", "--lockstep"]
    told = inside("new", "plant", "first_try", "--json").json()
    assert told["folder"] == "first_try"
    assert {str(Path(file)) for file in told["files"]} == {
        str(path.relative_to("first_try")) for path in Path("first_try").rglob("*.*")
    }
    assert inside("new", "plant", "first_try").code == 2


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """One package of each kind, and where pip has put them."""
    folder = tmp_path_factory.mktemp("new")
    packages = {kind: write_package(kind, f"first_{kind}", folder / kind).folder for kind in KINDS}
    site = folder / "site"
    words = ("-m", "pip", "install", "--quiet", "--no-deps", "--target", site)
    subprocess.run([sys.executable, *words, *packages.values()], check=True)
    return packages, site


@pytest.mark.slow
@every_kind
def test_it_installs_passes_its_own_tests_and_runs_well(kind, installed, tmp_path):
    packages, site = installed
    given = {**os.environ, "PYTHONPATH": os.pathsep.join([str(HOUSE), str(site)])}
    tests = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    done = subprocess.run(
        tests, cwd=packages[kind], env=given, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout
    assert "passed" in done.stdout
    run = (packages[kind] / "README.md").read_text(encoding="utf-8").partition("`hoap3 ")[2]
    words = [*run.partition("`")[0].split(), "--out", tmp_path / "log"]
    code = "from hoap3.tools.cli.app import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, *words],
        cwd=packages[kind], env=given, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
