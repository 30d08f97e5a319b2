"""Robot and controller of versions 1 and 2 of the wire, in all pairings, as processes."""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import subprocess
import sys
import tarfile
import venv
from pathlib import Path

import pytest
from support import HOUSE
from support.command_bench import endpoint as free_endpoint

from hoap3.tools.logs.log import Log
from hoap3.tools.verify.verify import verify

VERSION_1 = "b45227f46ed8ba6ad1b23534ba198196d3474348"
"""The last commit before anything of version 2."""
PATIENCE_S = 120.0
pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def interpreters(tmp_path_factory: pytest.TempPathFactory) -> dict[int, list[str]]:
    """Python with the wheel of version 1 in an environment of its own, and ours."""
    folder = tmp_path_factory.mktemp("version_1")
    archive = subprocess.run(
        ["git", "-C", str(HOUSE), "archive", VERSION_1], capture_output=True, check=True
    ).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as source:
        source.extractall(folder / "source", filter="data")
    venv.create(folder / "env", with_pip=True)
    old = str(folder / "env" / "bin" / "python")
    given = {**os.environ, "PIP_CONSTRAINT": str(HOUSE / "constraints.txt")}
    subprocess.run([old, "-m", "pip", "install", "-q", folder / "source"], check=True, env=given)
    found = {1: [old], 2: [sys.executable]}
    for python in found.values():  # kernels are compiled here, and not while the other side waits
        first = start(
            python, "run", "--lockstep", "--duration", "0.01", "--out", "first", cwd=folder
        )
        first.communicate(timeout=20 * PATIENCE_S)
        shutil.rmtree(folder / "first")
    return found


def start(python: list[str], *words: str, cwd: Path) -> subprocess.Popen[str]:
    """A command of ours, by an interpreter, outside the checkout."""
    code = "import sys; from hoap3.tools.cli.app import main; sys.exit(main())"
    ours = python[0] == sys.executable
    env = {name: value for name, value in os.environ.items() if ours or name != "PYTHONPATH"}
    return subprocess.Popen(
        [*python, "-c", code, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=cwd,
        env=env,
    )


@pytest.mark.parametrize("lockstep", [True, False])
@pytest.mark.parametrize(("robot", "controller"), [(1, 1), (1, 2), (2, 1), (2, 2)])
def test_two_seconds_of_motion(robot, controller, lockstep, interpreters, tmp_path):
    endpoint = free_endpoint()
    how = ["--lockstep"] if lockstep else ["--no-realtime", "--set", "misses_to_stop=1000"]
    listen = f'link.listen=["{endpoint}"]'
    emulator = start(
        interpreters[robot],
        *("emulator", "hoap3", "--duration", "2", "--json", "--out", str(tmp_path / "run")),
        *(*how, "--set", listen),
        cwd=tmp_path,
    )
    client = start(
        interpreters[controller],
        *("controller", "qp12", "--no-realtime", "--out", str(tmp_path / "run")),
        *("--set", f'link.connect=["{endpoint}"]'),
        cwd=tmp_path,
    )
    told, robot_said = emulator.communicate(timeout=PATIENCE_S)
    client.send_signal(signal.SIGINT)
    _, controller_said = client.communicate(timeout=PATIENCE_S)

    assert emulator.returncode in {0, 1}, robot_said
    assert client.returncode in {0, 1}, controller_said
    found = json.loads(told)
    assert found["misses"]["rejected"] == 0
    assert found["final_error"] < 0.01
    if lockstep:
        assert found["success_rate"]["run"] == 1.0
        assert found["final_error"] == pytest.approx(0.00376, abs=1e-5)
    said = {robot: robot_said, controller: controller_said}
    for version, text in said.items():
        other = controller if version == robot else robot
        old_peer = version == 2 and other == 1
        assert text.count("wire version 1") == int(old_peer), text
    for side, version in (("robot", robot), ("controller", controller)):
        log = Log.open(tmp_path / "run", side=side)
        assert log.wire_version == version
        tells = controller == 2 and (side == "controller" or robot == 2)
        assert log.setpoints()["decision"].shape[1] == (21 if tells else 0)
    assert verify(tmp_path / "run").claims.by_tick() == []
