"""A robot and its controller under attack: `flood_bench.py KIND [TIMES [SECONDS]]` prints figures.

Kinds are those of `floods.py`. In each flood the robot is stopped through its local socket and
recovered again and again; afterwards it has to follow its controller again.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from support.command_bench import PATIENT, QUIET, Command, assert_no_traceback, endpoint, followed

from hoap3.protocol.errors import LinkError
from hoap3.protocol.link.local_control import LocalRobot, local_robots

FLOODS = str(Path(__file__).parent / "floods.py")
STOP_EVERY_S = 0.25
BACK_S = 30.0  # after which a controller is not expected any more
_PROBE_S = 0.02


@dataclass
class Flood:
    """What one flood did.

    Attributes:
        stops_ms: times that `stop` took over the local socket, during the flood [ms].
        unanswered: stops that the robot did not answer, or after which it did not stop.
        back_s: from the end of the flood until the robot followed its controller [s]; -1: never.
        robot_mb, controller_mb: largest resident memory so far [MB].
        sent, cut: what the attacker says.
        ended: exit codes of services that ended meanwhile.
    """

    kind: str
    stops_ms: list[float] = field(default_factory=list)
    unanswered: int = 0
    back_s: float = -1.0
    robot_mb: int = 0
    controller_mb: int = 0
    sent: int = 0
    cut: int = 0
    ended: list[int] = field(default_factory=list)


def measure(kind: str, times: int, seconds: float, tell: Callable[[Flood], None]) -> list[Flood]:
    """Attack a robot that follows its controller, so many times; `kind` "none" is no attack."""
    at, floods = endpoint(), []
    robot, law = ("--set", "name=flooded"), ("--set", "robot=flooded")
    with followed(at, robot=(*QUIET, *PATIENT, *robot), law=(*QUIET, *law)) as services:
        (local,) = [one for one in local_robots() if one.name == "flooded"]
        _follows(local)
        for _ in range(times):
            floods.append(_one_flood(kind, at, seconds, local, services))
            tell(floods[-1])
        for service in reversed(services):
            assert floods[-1].ended or service.end(signal.SIGTERM) in {0, 1}
            assert_no_traceback(service)
    return floods


def _one_flood(
    kind: str, at: str, seconds: float, local: LocalRobot, services: tuple[Command, Command]
) -> Flood:
    flood = Flood(kind)
    if kind == "none":
        words = [sys.executable, "-c", f"import time; time.sleep({seconds}); print('{{}}')"]
    else:
        words = [sys.executable, FLOODS, kind, at, local.name, str(seconds)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as attacker:
        while attacker.poll() is None:
            begin = time.monotonic()
            if _asked(local, "stop")["mode"] in {"idle", "stopping", "stopped"}:
                flood.stops_ms.append(round((time.monotonic() - begin) * 1e3, 1))
            else:
                flood.unanswered += 1
            _asked(local, "recover")
            time.sleep(STOP_EVERY_S)  # the rate of the stops, nothing that is waited for
        said = json.loads(attacker.communicate()[0])
    flood.sent, flood.cut = said.get("sent", 0), said.get("cut", 0)
    flood.back_s = _follows(local)
    flood.robot_mb, flood.controller_mb = (_peak_mb(one.process.pid) for one in services)
    flood.ended = [one.process.returncode for one in services if one.process.poll() is not None]
    return flood


def _follows(local: LocalRobot) -> float:
    """Wait until the robot follows a controller, recovering it where it is latched; how long."""
    begin = time.monotonic()
    while (waited := time.monotonic() - begin) < BACK_S:
        status = _asked(local, "status")
        if status["mode"] == "active":
            return round(waited, 2)
        if status["mode"] == "stopped" and status["holder"] is not None:
            _asked(local, "recover")
        time.sleep(_PROBE_S)
    return -1.0


def _asked(local: LocalRobot, verb: str) -> dict[str, Any]:
    try:
        return local.ask(verb)
    except LinkError:
        return {"mode": "unknown", "holder": None}


def _peak_mb(pid: int) -> int:
    """Largest resident memory of a process so far [MB]; 0 where it has ended."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return 0
    found = [line.split()[1] for line in lines if line.startswith("VmHWM")]
    return int(found[0]) // 1024 if found else 0


if __name__ == "__main__":
    _, attack, *rest = sys.argv
    repeats = int(rest[0]) if rest else 1
    lasting = float(rest[1]) if rest[1:] else 10.0
    measure(attack, repeats, lasting, lambda flood: print(json.dumps(asdict(flood)), flush=True))
