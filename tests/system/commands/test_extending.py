"""What users add: a controller of their own, a robot of their own, a client without our code."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from support import arm3
from support.command_bench import (
    PATIENT,
    assert_at_rest,
    assert_ran,
    emulator,
    endpoint,
    events,
    hoap3,
    inside,
    on_path,
)

from hoap3.protocol.messages import State
from hoap3.remote_controller.registry import BUILTIN
from hoap3.tools.logs.log import Log

pytestmark = pytest.mark.slow

CONTROLLER = '''
"""A controller as somebody else would write it."""

import numpy as np

from hoap3.remote_controller.controllers.base import VelocityController


class Sway(VelocityController):
    """All joints swing about where they started."""

    class Parameters(VelocityController.Parameters):
        speed_rad_s: float = 0.1

    def velocity(self, state):
        return np.full(self.description.n, self.parameters.speed_rad_s * np.cos(state.tick * 1e-3))
'''
LOCKSTEP = ("run", "--lockstep", "--duration", "0.2")


def shipped(folder: Path) -> Path:
    """A distribution that registers a controller, installed as pip lays it down."""
    site = folder / "site"
    facts = site / "sway_law-1.0.dist-info"
    facts.mkdir(parents=True)
    (site / "sway_law.py").write_text(CONTROLLER)
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: sway-law\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text("[hoap3.controllers]\nsway = sway_law:Sway\n")
    return site


def moved(folder: Path) -> float:
    """How far any joint went."""
    reference = Log.open(folder, side="robot").states()["reference"]
    return float(np.abs(reference - reference[0]).max())


def test_an_installed_controller_is_found_by_its_name(tmp_path: Path) -> None:
    (tmp_path / "sway").mkdir()  # a folder of that name in the way does not matter
    surroundings = {"cwd": tmp_path, "environment": on_path(shipped(tmp_path))}
    listed = hoap3("list", "--json", **surroundings)
    assert listed.json()["controllers"] == sorted([*BUILTIN, "sway"])
    run = hoap3(*LOCKSTEP, "--controller", "sway", "--out", "log", **surroundings)
    assert run.end() == 0, run.stderr
    assert moved(tmp_path / "log") > 0.01
    again = hoap3("replay", "log", **surroundings)  # it is registered: no --allow-code
    assert again.end() == 0
    assert "200/200 setpoints identical" in again.stdout
    schema = hoap3("config", "schema", "sway", **surroundings).json()
    assert "speed_rad_s" in schema["properties"]["parameters"]["properties"]


def test_a_robot_of_ones_own_with_a_controller_of_ones_own(tmp_path: Path) -> None:
    robot, law = tmp_path / "robot", tmp_path / "law"
    robot.mkdir()
    law.mkdir()
    arm3.write(robot)
    (law / "arms_own.py").write_text(CONTROLLER)
    (law / "law.yaml").write_text("controller: arms_own:Sway\nparameters: {speed_rad_s: 0.3}\n")
    words = ("--duration", "0.2", "--robot", "robot", "--controller", "law/law.yaml", "--json")
    run = hoap3("run", *words, "--out", "log", cwd=tmp_path)
    assert run.end() in {0, 1}, run.stderr
    log = Log.open(tmp_path / "log", side="robot")
    assert log.robot == "arm3"
    assert log.states()["q"].shape[1] == 3
    assert_at_rest(log)
    assert moved(tmp_path / "log") > 0
    assert inside("replay", tmp_path / "log").code == 2  # code, on the word of a log


def test_a_task_of_ones_own_robot_by_a_shipped_controller(tmp_path: Path) -> None:
    arm3.write(tmp_path)
    place = {"point": "com", "reference_frame": "base", "target_m": [0.19, 0.08, 0.22]}
    law = {"controller": "qp12", "robot": "arm3", "parameters": {**place, "gamma": 0.0}}
    (tmp_path / "law.yaml").write_text(yaml.safe_dump(law))
    words = ("--robot", tmp_path, "--controller", tmp_path / "law.yaml", "--json")
    run = inside("run", "--lockstep", "--duration", "5", *words, "--out", tmp_path / "log")
    assert_ran(run)
    setpoints = Log.open(tmp_path / "log", side="controller").setpoints()
    assert setpoints["v"][-1] < 0.1 * setpoints["v"][0]


CLIENT = """
import json, os, struct, sys
import zenoh

endpoint, robot, ticks = sys.argv[1], sys.argv[2], int(sys.argv[3])
who = f"stranger-{os.getpid()}"
config = {
    "mode": "client",
    "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
    "connect": {"endpoints": [endpoint]},
}
with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
    def ask(verb):
        replies = session.get(f"robots/{robot}/ask/{verb}/{who}", timeout=5.0)
        return json.loads(next(iter(replies)).ok.payload.to_bytes())

    n = len(ask("description")["joints"])
    token = session.liveliness().declare_token(f"robots/{robot}/clients/{who}")
    states = session.declare_subscriber(f"robots/{robot}/state/2", zenoh.handlers.RingChannel(1))
    setpoints = session.declare_publisher(
        f"robots/{robot}/setpoint/{who}", express=True, priority=zenoh.Priority.REAL_TIME
    )
    grant = ask("acquire")
    assert grant["granted"]
    answered, last = 0, None
    while answered < ticks:
        state = states.recv().payload.to_bytes()
        assert struct.unpack_from("<4sI", state) == (b"\\0\\1\\0\\0", 2)
        mode, session_id, tick, epoch = struct.unpack_from("<IQQQ", state, 8)
        if mode != 1 or epoch != grant["epoch"] or tick == last:
            continue
        (published,) = struct.unpack_from("<q", state, 60)
        values = list(struct.unpack_from(f"<{n}d", state, 164 + 24 * n))
        values[0] += 1e-5
        head = (2, 0, session_id, tick, epoch, published, 0, 0, 0, 0, 0, 0)
        body = struct.pack("<II3Q7q6d4II4x", *head, *[0.0] * 6, 0, 4, 0, 0, n)
        setpoints.put(b"\\0\\1\\0\\0" + body + struct.pack(f"<{n}d5I", *values, *[0] * 5))
        answered, last = answered + 1, tick
    print(json.dumps({**ask("release"), "answered": answered, "first": grant["from_tick"]}))
    token.undeclare()
assert "hoap3" not in sys.modules
"""


def test_a_client_without_our_code_drives_the_robot(tmp_path: Path) -> None:
    """Written from docs/reference/wire.md, with nothing but zenoh and struct."""
    at, out = endpoint(), tmp_path / "log"
    with emulator("hoap3", *PATIENT, "--out", out, at=at) as robot:
        words = [sys.executable, "-c", CLIENT, at, "hoap3", "200"]
        client = subprocess.run(words, capture_output=True, text=True, check=False, timeout=120)
        assert client.returncode == 0, client.stderr
        robot.wait_for(r"braking \(released\)")
        robot.wait_for("at rest")
        assert robot.end(15) in {0, 1}
    assert '"released": true' in client.stdout
    log = Log.open(out, side="robot")
    assert ("GRANTED", 1) in events(log)
    assert_at_rest(log)
    states, last = log.states(), log.states()[-1]
    asked = int((states["mode"] == State.ACTIVE).sum())
    missed = int(last["late"] + last["lost"])
    assert last["rejected"] == 0
    assert asked - missed <= len(log.setpoints()) <= 200  # Zenoh drops some on a busy machine
    assert asked - missed > 20  # of 200; busy machines miss many
    assert states["reference"][-1][0] > states["reference"][0][0]
