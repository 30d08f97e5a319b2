"""Names of joints and links that look like words or separators of ours keep their meaning."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from support.command_bench import inside
from support.urdfs.vendor_arm import joint, link, urdf

import hoap3
from hoap3.protocol.errors import ConfigError, DescriptionError
from hoap3.protocol.messages import State
from hoap3.protocol.robot.pinocchio_model import build_model
from hoap3.remote_controller.model.free_dynamics import FreeDynamics
from hoap3.tools.bridge.frame_transforms import world_frame
from hoap3.tools.bridge.panel_targets import Clicked, check_frame
from hoap3.tools.logs.log import Log

pytestmark = pytest.mark.filterwarnings("ignore::hoap3.protocol.errors.UrdfWarning")

WORDS = [
    "a", "a/velocity", "a.b", "arm/j1", "t", "time", "tick", "qx", "x", "com", "world", "q0",
    "log_time", "all", "none", "null", "true", "1", "universe", "root_joint", "-", "a[0]",
    "b c", "d,e", "f=g", "#x", "é", "__proto__",
]  # fmt: skip


def chain(names: list[str], links: list[str]) -> str:
    """Of a robot whose joints, about y, are called so, with its links in this order."""
    made = "".join(map(link, links))
    ends = zip(names, links, links[1:], strict=False)
    return urdf(made, "".join(joint(name, *each) for name, *each in ends))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the robot `arm.urdf` and the log of a run, `log`."""
    at = tmp_path_factory.mktemp("names")
    links = ["base", *(f"l{k}" for k in range(len(WORDS)))]
    (at / "arm.urdf").write_text(chain(WORDS, links), encoding="utf-8")
    run = "run", "--lockstep", "--robot", at / "arm.urdf", "--duration", "0.3"
    assert inside(*run, "--out", at / "log", "--json").json()["log"]
    return at


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_each_column_of_an_export_is_of_one_joint(folder, ending, tmp_path):
    file = tmp_path / f"a.{ending}"
    assert inside("export", folder / "log", "--to", file).code == 0
    robot = hoap3.load_robot(folder / "arm.urdf")
    about = json.loads(file.with_suffix(".json").read_text())["columns"]
    of = [each["of"] for each in about.values() if each["field"] == "q" and "of" in each]
    assert of == list(robot.joint_names)
    assert len(set(robot.joint_names)) == len(WORDS)
    if ending == "csv":
        with file.open(encoding="utf-8", newline="") as stream:
            header, first, *_ = csv.reader(stream)
        assert header == list(about)
        states = Log.open(folder / "log", "robot").states()
        title = next(t for t, each in about.items() if each.get("of") == "qx")
        place = robot.joint_names.index("qx")
        assert float(first[header.index(title)]) == states["q"][0, place]


def test_the_motion_of_a_log_comes_back(folder, tmp_path):
    file = tmp_path / "a.csv"
    assert inside("trajectory", "from", folder / "log", "--out", file).code == 0
    check = "trajectory", "check", file, "--robot", folder / "arm.urdf", "--json"
    told = inside(*check).json()
    assert told["columns"] == list(hoap3.load_robot(folder / "arm.urdf").joint_names)


@pytest.mark.slow
def test_a_run_along_that_motion_is_verified(folder, tmp_path):
    file = tmp_path / "a.csv"
    inside("trajectory", "from", folder / "log", "--out", file)
    target = {"kind": "trajectory", "file": str(file)}
    task = {"task": "posture", "parameters": {"target": target}}
    config = {"controller": "ghc_velocity", "parameters": {"tasks": [task]}}
    (tmp_path / "law.yaml").write_text(json.dumps(config))
    run = "run", "--lockstep", "--robot", folder / "arm.urdf", "--duration", "0.2"
    inside(*run, "--controller", tmp_path / "law.yaml", "--out", tmp_path / "log")
    done = inside("verify", tmp_path / "log", "--json")
    assert done.code == 0, done.stdout


def test_joints_named_like_axes_are_the_joints(tmp_path):
    (tmp_path / "a.urdf").write_text(chain(["x", "y", "z"], ["base", "a", "b", "c"]))
    file = tmp_path / "a.csv"
    file.write_text("t,x,y,z\n0,0,0,0\n1,3,0,0\n2,0,0,0\n")
    done = inside("trajectory", "check", file, "--robot", tmp_path / "a.urdf", "--json")
    told = done.json()
    assert {each["joint"] for each in told["exceeded"]} == {"x"}
    assert any("joints" in hint for hint in told["hints"])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["com", "universe"])
def test_a_link_with_a_reserved_name_is_renamed_or_refused(name, tmp_path):
    text = chain(["j1", "j2"], ["base", "a", name])
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    robot = hoap3.load_robot(path)
    assert robot.default_task is not None
    point, move = robot.default_task.point, robot.default_task.move_m
    assert point not in {"com", "universe"}
    model = build_model(robot)
    before = model.pose_in(point, "base", robot.initial_position)[:3]
    run = hoap3.simulate(path, "clik", duration=5.0)
    after = model.pose_in(point, "base", run.states["q"][-1])[:3]
    np.testing.assert_allclose(after - before, move, atol=1e-3)
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "a.urdf").write_text(text)
    (tmp_path / "own" / "robot.yaml").write_text("name: own\nurdf: a.urdf\n")
    with pytest.raises(DescriptionError, match=rf"'{name}'"):
        hoap3.load_robot(tmp_path / "own")


def test_a_joint_called_like_the_free_base_is_itself(tmp_path):
    found = []
    for name in ("root_joint", "hip"):
        path = tmp_path / f"{name}.urdf"
        path.write_text(chain([name, "knee"], ["base", "a", "b"]))
        robot = hoap3.load_robot(path)
        free = FreeDynamics(robot, [], 0)
        free.update(np.array([0.3, -0.4]), np.array([0.5, 0.6]))
        found.append((free.mass.copy(), free.bias.copy()))
    for ours, theirs in zip(*found, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-12)


def test_a_link_called_world_is_not_the_frame_of_a_panel(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(chain(["j1", "j2"], ["base", "world", "tip"]))
    robot = hoap3.load_robot(path)
    assert world_frame(robot) not in robot.frames
    clicked = Clicked("world", (0.0, 0.0, 0.0))
    with pytest.raises(hoap3.UsageError):
        check_frame(clicked, robot)


@pytest.mark.slow
def test_settings_by_joint_take_any_name(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(chain(["a.b", "c"], ["base", "a", "b"]))
    run = "run", "--lockstep", "--duration", "0.05", "--robot", path, "--json"
    mujoco = "--set", "emulator.plant.kind=mujoco"
    key = 'emulator.plant.parameters.armature."a.b"'
    done = inside(*run, *mujoco, "--set", f"{key}=0.5", "--out", tmp_path / "log")
    assert done.json()["log"], done.stderr
    done = inside(*run, *mujoco, "--set", f"{key}=no", "--out", tmp_path / "other")
    assert done.code == 2
    assert "'a.b'" in done.stderr


def test_two_columns_of_one_name_are_refused():
    class Twice(hoap3.VelocityController):
        extra_names = ("error", "error")

        def velocity(self, state: State) -> np.ndarray:
            """Stay."""
            return np.zeros(self.description.n)

    with pytest.raises(ConfigError, match="'error'"):
        Twice(hoap3.load_robot("ur5"), Twice.Parameters())
