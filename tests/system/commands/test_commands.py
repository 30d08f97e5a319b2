"""Other commands once, with their results."""

from __future__ import annotations

import json
import re
import signal
from importlib import metadata
from pathlib import Path

import pytest
import yaml
from support.command_bench import (
    PATIENT,
    QUIET,
    Command,
    assert_no_traceback,
    assert_ran,
    controller,
    emulator,
    endpoint,
    inside,
    tell,
    wait_for_mode,
)

from hoap3.protocol.messages import State
from hoap3.remote_controller import registry as controllers
from hoap3.remote_controller.constraints import registry as constraints
from hoap3.remote_controller.tasks import registry as tasks
from hoap3.tools.logs.log import Log

TASKS, CONSTRAINTS = sorted(tasks.BUILTIN), sorted(constraints.BUILTIN)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("commands") / "log"
    assert_ran(inside("run", "--lockstep", "--duration", "0.2", "--out", made))
    return made


def test_version_names_the_stack() -> None:
    done = inside("--version")
    lines = dict(line.split(" ", 1) for line in done.stdout.splitlines())
    assert done.code == 0
    assert lines["hoap3"] == metadata.version("hoap3")
    for name in ("python", "eclipse-zenoh", "numpy", "numba", "pin", "mcap"):
        assert lines[name][0].isdecimal()


def test_list_knows_what_can_be_named() -> None:
    found = inside("list", "--json").json()
    assert "hoap3" in found["robots"]
    assert set(found["controllers"]) >= {"qp12", "pinv"}
    assert set(found["controller configs"]) >= {"qp12", "pinv"}
    assert set(found["emulator configs"]) >= {"baxter", "hoap3"}
    assert set(found["tasks"]) >= set(TASKS)
    assert set(found["constraints"]) >= set(CONSTRAINTS)
    assert set(found["curves"]) >= {"ellipse", "joint_ellipse"}
    people = inside("list")
    assert people.stderr == ""
    assert "joint_acceleration, osqp, pinv, qp12" in people.stdout


@pytest.mark.parametrize("name", ["hoap3", "baxter", "qp12", "pinv", "osqp", "tsid"])
def test_a_shown_config_is_a_config(name: str, tmp_path: Path) -> None:
    shown = inside("config", "show", name)
    copy = tmp_path / "copy.yaml"
    copy.write_text(shown.stdout)
    again = inside("config", "show", copy)
    assert again.stdout == shown.stdout
    checked = inside("config", "check", copy, name)
    assert checked.code == 0
    side = "emulator" if name in {"hoap3", "baxter"} else "controller"
    assert re.search(f"{copy}.* {side}", checked.stdout)


def test_show_tells_what_a_set_would_do() -> None:
    shown = inside("config", "show", "qp12", "--set", "parameters.gamma=0.25")
    assert yaml.safe_load(shown.stdout)["parameters"]["gamma"] == 0.25


@pytest.mark.parametrize("kind", ["emulator", "controller", "qp12", "pinv", "osqp", "tsid"])
def test_a_schema_describes_every_key_of_the_config(kind: str) -> None:
    schema = inside("config", "schema", kind).json()
    name = "hoap3" if kind == "emulator" else "qp12" if kind == "controller" else kind
    content = yaml.safe_load(inside("config", "show", name).stdout)
    assert schema["properties"].keys() == content.keys()
    assert schema["additionalProperties"] is False
    if kind in {"qp12", "pinv", "osqp", "tsid"}:
        parameters = schema["properties"]["parameters"]
        assert parameters["properties"].keys() == content["parameters"].keys()


ENTRIES = [("task", name) for name in TASKS] + [("constraint", name) for name in CONSTRAINTS]


@pytest.mark.parametrize(("kind", "name"), [("controller", "qp12"), *ENTRIES])
def test_a_schema_of_an_entry_has_its_own_parameters(kind: str, name: str) -> None:
    schema = inside("config", "schema", kind, name).json()
    whole = inside("config", "schema", kind).json()
    assert schema["properties"].keys() == whole["properties"].keys()
    parameters = schema["properties"]["parameters"]
    assert parameters["additionalProperties"] is False
    family = {"controller": controllers, "task": tasks, "constraint": constraints}[kind]
    assert parameters["properties"].keys() == family.find(name).Parameters.model_fields.keys()
    named = set(re.findall(r'"#/\$defs/(\w+)"', json.dumps(schema)))
    assert named <= schema.get("$defs", {}).keys()


def test_all_logs_of_a_folder_are_repaired(folder: Path, tmp_path: Path) -> None:
    whole = (folder / "robot.mcap").read_bytes()
    (tmp_path / "robot.mcap").write_bytes(whole[:-100])
    (tmp_path / "robot.0001.mcap").write_bytes(whole)
    done = inside("record", "--repair", tmp_path, "--json")
    assert done.code == 0
    repaired = {Path(each["path"]).name: each["whole"] for each in done.json()["logs"]}
    assert repaired == {"robot.mcap": False, "robot.0001.mcap": True}
    assert Log.open(tmp_path / "robot.repaired.mcap").states().size > 0
    (tmp_path / "robot.repaired.mcap").unlink()
    (tmp_path / "controller.mcap").write_bytes(b"noise")
    again = inside("record", "--repair", tmp_path)
    assert again.code == 2
    assert (tmp_path / "robot.repaired.mcap").exists()
    assert again.stderr.startswith("error: ")
    assert "controller.mcap" in again.stderr


@pytest.mark.slow
def test_status_live_list_and_a_recording_from_outside(tmp_path: Path) -> None:
    at, out = endpoint(), tmp_path / "log"
    with (
        emulator("hoap3", *QUIET, *PATIENT, "--set", "name=test_robot", at=at) as robot,
        controller("qp12", *QUIET, "--set", "robot=test_robot", at=at) as law,
    ):
        idle = tell("status", at, "test_robot")
        assert (idle["mode"], idle["holder"], idle["lockstep"]) == ("idle", None, False)
        assert inside("list", "--live", "--json", "--connect", at).json()["alive"] == ["test_robot"]
        law.wait_for("following robot")
        with Command("record", "test_robot", "--connect", at, "--out", out, "--json") as record:
            record.wait_for("recording robot 'test_robot'")
            tick = wait_for_mode("active", at, "test_robot")["tick"]
            while tell("status", at, "test_robot")["tick"] < tick + 200:
                continue
            people = inside("status", "test_robot", "--connect", at)
            assert people.stdout.startswith("test_robot: active, follows qp12-")
            assert record.end(signal.SIGINT) == 0, record.stderr
            assert_no_traceback(record)
        assert law.end(signal.SIGTERM) == 0
        assert robot.end(signal.SIGTERM) in {0, 1}
    counts = record.json()
    log = Log.open(out / "robot.mcap")
    assert counts["states"] == len(log.states()) > 0
    assert counts["setpoints"] == len(log.setpoints()) > 0
    assert (log.states()["mode"] == State.ACTIVE).any()
    assert log.description.name == "test_robot"
    assert inside("export", out, "--to", tmp_path / "outside.csv").code == 0
    assert inside("replay", out).code == 2  # a replay needs the controller's own log
