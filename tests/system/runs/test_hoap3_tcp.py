"""HOAP-3's own protocol between our services, and with a program that is not ours."""

from __future__ import annotations

import json
import shutil
import socket
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.command_bench import (
    Command,
    assert_at_rest,
    assert_no_traceback,
    assert_ran,
    events,
    free_port,
    inside,
)

from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.tools.logs.log import Log
from hoap3.tools.verify.verify import verify

HERE = Path(__file__).parent
NEAR_M = 3e-5
pytestmark = pytest.mark.slow

QP12 = "--controller", "qp12"
SOON, LATER = (("paper", 22), ("legacy", 21)), (("paper", 21), ("legacy", 22))
PAIRS = [*SOON, *(pytest.param(*pair, marks=pytest.mark.long) for pair in LATER)]
COMPILER = shutil.which("cc")
DRIVERS = [COMPILER, None] if COMPILER else [None]  # None: in Python


class Place:
    """Two free ports, and how to name them."""

    def __init__(self, order: str, slots: int) -> None:
        self.ports = free_port(), free_port()
        keys = {"init_port": self.ports[0], "control_port": self.ports[1]}
        given = {**keys, "order": order, "slots": slots}
        each = [f"link.hoap3_tcp.{key}={value}" for key, value in given.items()]
        self.words = [word for text in ("link.kind=hoap3_tcp", *each) for word in ("--set", text)]


def last_com(folder: Path) -> np.ndarray:
    log = Log.open(folder, side="robot")
    description: RobotDescription = log.description
    robot = Robot(description)
    robot.place(log.states()["q"][-1])
    return robot.com(description.base_frame)[0]


@pytest.fixture(scope="module")
def over_zenoh(tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    """Where the CoM ends in the same run over Zenoh, with encoders that count."""
    folder = tmp_path_factory.mktemp("zenoh") / "run"
    counts = "--set", "emulator.plant.encoder=counts"
    assert_ran(inside("run", *QP12, "--lockstep", "--duration", "2", "--out", folder, *counts))
    return last_com(folder)


@pytest.mark.parametrize(("order", "slots"), PAIRS)
def test_the_robot_ends_where_it_does_over_zenoh(order, slots, over_zenoh, tmp_path):
    place, folder = Place(order, slots), tmp_path / "run"
    words = "hoap3", "--lockstep", "--duration", "2", "--out", folder, *place.words
    with Command("emulator", *words) as robot:
        robot.wait_for("is alive at")
        with Command("controller", "qp12", "--out", folder, *place.words) as law:
            assert robot.end() == 0, robot.stderr
            law.wait_for("is gone")
            assert law.end(15) == 0, law.stderr
            assert_no_traceback(law)
    assert_no_traceback(robot)

    log = Log.open(folder, side="robot")
    last = log.states()[-1]
    assert len(log.setpoints()) == 2000
    assert last["late"] == last["lost"] == last["rejected"] == last["duplicate"] == 0
    (summary,) = (record for record in log.records() if record.kind == Kind.SUMMARY)
    counts = json.loads(summary.payload)["link_counts"]
    assert counts["overruns"] == counts["unasked"] == counts["not_finite"] == 0
    assert_at_rest(log)
    assert np.linalg.norm(last_com(folder) - over_zenoh) < NEAR_M
    assert "identical" in inside("replay", folder).stdout
    assert verify(folder).claims.by_tick() == []


@pytest.mark.parametrize(("order", "slots"), PAIRS)
def test_in_real_time_it_ends_there_too(order, slots, tmp_path):
    """After 6 s the CoM has come to its target, so that a tick that was missed is made up for."""
    over_zenoh, folder = tmp_path / "zenoh", tmp_path / "run"
    time, counts = ("--duration", "6"), ("--set", "emulator.plant.encoder=counts")
    assert_ran(inside("run", *QP12, "--lockstep", *time, "--out", over_zenoh, *counts))
    keys = f"order={order}", f"slots={slots}"
    each = ["link.kind=hoap3_tcp", *(f"link.hoap3_tcp.{key}" for key in keys)]
    words = [f"emulator.{text}" for text in (*each, "misses_to_stop=9999", "name=other")]
    given = [word for text in words for word in ("--set", text)]
    done = inside("run", *QP12, *time, "--out", folder, "--json", *given)
    assert done.code in {0, 1}, done.stderr
    told = done.json()
    assert np.linalg.norm(last_com(folder) - last_com(over_zenoh)) < NEAR_M
    assert told["transport"].startswith("hoap3_tcp")
    assert told["rtt_us"]["n"] > 100
    assert told["stages_us"]["solve"]["n"] == 0  # the client's stamps do not travel
    link, misses, outside = told["link_counts"], told["misses"], told["misses_outside_stalls"]
    assert link["unasked"] == link["not_finite"] == link["refused"] == 0
    if outside is not None:  # stalls of the host are known: each overrun, a miss, is within one
        assert link["overruns"] <= misses["late"] + misses["lost"] + told["skipped"] - outside
    assert_at_rest(Log.open(folder, side="robot"))
    assert verify(folder).claims.by_tick() == []


@pytest.fixture(scope="module", params=DRIVERS)
def driver(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """A client that has nothing of ours."""
    if request.param is None:
        return [sys.executable, str(HERE / "hoap3_client.py")]
    made = tmp_path_factory.mktemp("driver") / "hoap3_client"
    source = str(HERE / "hoap3_client.c")
    subprocess.run([request.param, "-O1", "-Wall", "-Werror", "-o", made, source], check=True)
    return [str(made)]


@pytest.mark.parametrize("order", ["paper", "legacy"])
@pytest.mark.parametrize("how", ["--lockstep", "--no-realtime"])
def test_another_program_has_its_500_exchanges(how, order, driver, tmp_path):
    place, folder = Place(order, 21), tmp_path / "run"
    patient = "--set", "misses_to_stop=100000"
    with Command("emulator", "hoap3", how, "--out", folder, *patient, *place.words) as robot:
        robot.wait_for("is alive at")
        ports = [str(port) for port in place.ports]
        words = [*driver, *ports, order, "21", "1"]
        done = subprocess.run(words, check=False, capture_output=True, text=True, timeout=120)
        assert robot.end(15) in {0, 1}, robot.stderr
    assert done.returncode == 0, done.stderr
    exchanges, count = done.stdout.split()
    assert int(exchanges) == 500
    assert int(count) > 0

    log = Log.open(folder, side="robot")
    whole = 500 if order == "paper" else 499  # there the first one only opens
    assert whole - len(log.setpoints()) in {0, 1}  # the robot may be ended before the last one
    assert "HOLDER_LOST" not in [name for name, _ in events(log)]
    assert_at_rest(log)
    assert verify(folder).claims.by_tick() == []


@pytest.mark.parametrize("sent", [84, 0, 1, 167])
def test_a_robot_whose_client_is_cut_off_within_an_exchange_comes_to_rest(sent, tmp_path):
    place, folder, frame = Place("paper", 21), tmp_path / "run", struct.Struct("<21d")
    with Command("emulator", "hoap3", "--lockstep", "--out", folder, *place.words) as robot:
        robot.wait_for("is alive at")
        with socket.create_connection(("127.0.0.1", place.ports[0])) as first:
            first.sendall(struct.pack("<2d", 1, 100))
            client = socket.create_connection(("127.0.0.1", place.ports[1]))
        with client:
            for _ in range(50):
                counts = frame.unpack(client.recv(frame.size, socket.MSG_WAITALL))
                client.sendall(frame.pack(counts[0] + 10, *counts[1:]))
            client.recv(frame.size, socket.MSG_WAITALL)
            client.sendall(frame.pack(*counts)[:sent])
        robot.wait_for("AT_REST|at rest|has gone")
        robot.end(15)
    log = Log.open(folder, side="robot")
    assert_at_rest(log)
    assert "HOLDER_LOST" in [name for name, _ in events(log)]
