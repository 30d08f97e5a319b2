"""Every kind of change that `hoap3 verify` must find in a log, and the logs that are changed."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from tampering import ran, rewrite

from hoap3.protocol.messages import Event, Setpoint, State
from hoap3.protocol.runtime.recorder import MemoryRecorder
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.loop import ControllerLoop
from hoap3.tools.logs.log import Log
from hoap3.tools.services.configs import load_controller_config, load_emulator_config
from hoap3.tools.services.simulate import Lockstep

SIDES = ("robot", "controller")
NAMES = {number: name for name, number in Event.schema.constants.items() if "REASON" not in name}
STAMPS = {
    Kind.STATE: ("stamp_intended", "stamp_actual", "stamp_published", "stamp_sent_previous"),
    Kind.SETPOINT: ("stamp_state", "stamp_received", "stamp_decoded", "stamp_encoded"),
}
INPUTS = (Kind.SUMMARY, Kind.RESET, Kind.CHANGE, Kind.REQUEST)
UNVERIFIED = {
    *("run_rate", "worst_window", "held_back_joints", "torque_limited", "interventions"),
    *("conflicting", "realtime", "link_counts", "plant", "plant_us"),
}
"""Of a robot's summary, as docs/guides/logs.md lists them."""
Places = Callable[[list[Record], random.Random], Any]


def plain(out: Path) -> Path:
    """QP12 on HOAP-3."""
    return ran(out, seconds=0.15)


def missing_deadlines(out: Path) -> Path:
    """Every answer is late until the robot stops safely."""
    slow = "emulator.lockstep.compute_time_us=1500", "emulator.misses_to_stop=50"
    return ran(out, sets=slow, seconds=0.15)


def changed_live(out: Path) -> Path:
    """`clik_sdp` on a UR5, with changes while it runs and conditions that begin and end."""
    shell = out.parent / "shell"
    law, start = "clik_sdp_writing", "emulator.posture=outstretched"
    ran(shell, "--robot", "ur5", "--controller", law, sets=[start], seconds=0.05)
    requests: dict[int, dict[str, Any]] = {40: {"beta_per_s": 5.0}, 80: {"delta": 1e-4}}

    def change(loop: ControllerLoop) -> None:
        request = requests.pop(loop.last_tick, None)
        if request is not None:
            loop.change(json.dumps({**request, "over_s": 0.02}).encode())

    recorders = {side: MemoryRecorder() for side in SIDES}
    run = Lockstep(
        load_emulator_config({"robot": "ur5", "posture": "outstretched"}, seed=0)[0],
        load_controller_config(law)[0],
        *recorders.values(),
        steer=change,
    )
    run.run(0.15)
    for side, recorder in recorders.items():
        rewrite(shell, side, out, lambda _, kept=recorder: kept.records)
    return out


LOGS = {"plain": plain, "missing deadlines": missing_deadlines, "changed live": changed_live}


def _places(records: list[Record], kind: Kind, name: str = "") -> list[int]:
    """Where records of a kind stand, events of a name only."""
    found = [place for place, record in enumerate(records) if record.kind == kind]
    if name:
        return [n for n in found if NAMES[Event.scalars(records[n].payload, "kind")[0]] == name]
    return found


def _field(message: Any, record: Record, field: str, by: int) -> Record:
    message.load(record.payload)
    setattr(message, field, getattr(message, field) + by)
    return record._replace(payload=message.dump())


def changes(run: Path, side: str) -> Iterator[tuple[str, Places]]:
    """Kinds of changes of one side of a run; each changes records in place, by a random number."""
    records = list(Log.open(run, side=side).records())
    places = _places(records, Kind.EVENT)
    events = {NAMES[Event.scalars(records[n].payload, "kind")[0]] for n in places}

    def removing(kind: Kind, name: str = "") -> Places:
        def change(records: list[Record], rng: random.Random) -> None:
            del records[rng.choice(_places(records, kind, name))]

        return change

    def shifting(kind: Kind, name: str = "") -> Places:
        def change(records: list[Record], rng: random.Random) -> None:
            place = rng.choice(_places(records, kind, name))
            by = rng.choice((-1, 1)) * rng.randint(2_500_000, 50_000_000)
            stamp = records[place].stamp + by
            records[place] = records[place]._replace(stamp=stamp if stamp >= 0 else -by)

        return change

    def altering(kind: Kind, field: str, name: str = "") -> Places:
        def change(records: list[Record], rng: random.Random) -> None:
            place = rng.choice(_places(records, kind, name))
            type_ = {Kind.EVENT: Event, Kind.STATE: State, Kind.SETPOINT: Setpoint}[kind]
            by = rng.randint(1_000, 5_000_000) if "stamp" in field else rng.choice((1, 2, 5))
            message = type_.like(records[place].payload) if kind != Kind.EVENT else Event()
            records[place] = _field(message, records[place], field, by)

        return change

    def rewording(kind: Kind) -> Places:
        def change(records: list[Record], rng: random.Random) -> None:
            place = rng.choice(_places(records, kind))
            content = json.loads(records[place].payload)
            known = content.keys() - (UNVERIFIED if side == "robot" else {"targets"})
            leaves = [(content, key) for key in sorted(known) if not _holds(content[key])]
            leaves += [leaf for key in sorted(known) for leaf in _leaves(content[key])]
            inner, key = rng.choice(leaves)
            inner[key] = _other(inner[key], rng)
            records[place] = records[place]._replace(payload=json.dumps(content).encode())

        return change

    for name in sorted(events):
        yield f"{side}: event {name} removed", removing(Kind.EVENT, name)
        for field in ("kind", "tick", "detail", "stamp", "session_id"):
            yield f"{side}: event {name} {field} changed", altering(Kind.EVENT, field, name)
        yield f"{side}: event {name} log time moved", shifting(Kind.EVENT, name)
    for kind in (Kind.SUMMARY, Kind.SESSION, Kind.DESCRIPTION):
        yield f"{side}: {kind.name} removed", removing(kind)
    for kind in (Kind.SUMMARY, Kind.SESSION):
        yield f"{side}: {kind.name} changed", rewording(kind)
    yield f"{side}: DESCRIPTION joint name invalid", _invalid_name
    for kind, fields in STAMPS.items():
        yield f"{side}: {kind.name} log time moved", shifting(kind)
        for field in fields:
            yield f"{side}: {kind.name} {field} changed", altering(kind, field)
    for kind in INPUTS:
        if _places(records, kind):
            yield f"{side}: {kind.name} log time moved", shifting(kind)


def _invalid_name(records: list[Record], rng: random.Random) -> None:
    place = rng.choice(_places(records, Kind.DESCRIPTION))
    content = json.loads(records[place].payload)
    rng.choice(content["joints"])["name"] = rng.choice(("", "a/b", "q w", "\n"))
    records[place] = records[place]._replace(payload=json.dumps(content).encode())


def _holds(content: Any) -> bool:
    return isinstance(content, dict | list) and bool(content)


def _leaves(content: Any) -> Iterator[tuple[Any, Any]]:
    """Every value that holds no others, as what it stands in, and its key."""
    if _holds(content):
        for key in list(content) if isinstance(content, dict) else range(len(content)):
            if _holds(content[key]):
                yield from _leaves(content[key])
            else:
                yield content, key


def _other(value: Any, rng: random.Random) -> Any:
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 1
    if isinstance(value, float):
        return value * (1.0 + 1e-3) + rng.choice((0.0, 1.0))
    if value is None:
        return {"least": 1.0, "tolerance": 0.1, "of": "", "unit": ""}
    return {"x": 1} if isinstance(value, dict) else [1] if isinstance(value, list) else value + "x"
