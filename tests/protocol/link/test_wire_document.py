"""docs/wire.md says what the code does: its tables, its answers, and its client."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from typing import get_args

import pytest
from loopback import PATIENCE_S, Network, free_endpoint
from support import HOUSE
from support.small_arm import arm

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.description import CommandKind, DeadlineRule, DefaultTask, Gravity
from hoap3.protocol.link.base import LockstepLink
from hoap3.protocol.link.remote_lockstep import RemoteLockstepLink
from hoap3.protocol.link.zenoh_link import ZenohRobotLink
from hoap3.protocol.messages import Event, Message, Setpoint, State, Target
from hoap3.protocol.runtime.clock import Clock, MonotonicClock, VirtualClock
from hoap3.protocol.runtime.recorder import NoRecorder
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.loop import EVENTS, GRACE_TICKS, RobotLoop
from hoap3.robot_emulator.setpoint_validator import HISTORY, MAX_LENGTHS, REJECTION_KINDS

PAGE = (HOUSE / "docs" / "wire.md").read_text(encoding="utf-8")


def section(title: str) -> str:
    """Text under a heading, up to the next one."""
    (found,) = re.findall(rf"^#+ {re.escape(title)}\n(.*?)(?=^#+ |\Z)", PAGE, re.DOTALL | re.M)
    return found


def table(text: str, head: str) -> list[dict[str, str]]:
    """Rows of the table whose head begins with `head`, by column; code marks removed."""
    found, _, _ = text[text.index(f"| {head} |") :].partition("\n\n")
    rows = [
        [cell.strip().replace("`", "") for cell in line.strip("|").split("|")]
        for line in found.splitlines()
    ]
    return [dict(zip(rows[0], row, strict=True)) for row in rows[2:]]


def offset(text: str, n: int) -> int:
    """Value of a formula such as `164 + 8n` for n joints, or of `52 + 8pd` for n = p · d."""
    total = 0
    for term in text.split("+"):
        number, symbol = re.fullmatch(r"(\d+)(n|pd)?", term.strip()).groups()
        total += int(number) * (n if symbol else 1)
    return total


def found_offset(message: Message, row: dict[str, str]) -> int | None:
    """Where the code puts a field: by changing it, or by looking for the memory of the array."""
    field = row["field"]
    zero = message.dump()
    if field.startswith("length of "):
        schema = message.schema
        lengths = schema.lengths_in(zero)
        return 4 + schema.offsets(lengths)[0][field.removeprefix("length of ")]
    if row["type"] == "float64[]":
        array = getattr(message, field)
        if not len(array):
            return None
        array[0] = -1.0
        changed = message.dump()
        array[0] = 0.0
        place = next(
            at for at, pair in enumerate(zip(zero, changed, strict=True)) if len({*pair}) > 1
        )
        return place - 6  # -1.0 is 00 00 00 00 00 00 f0 bf
    before = getattr(message, field)
    setattr(message, field, before + (2.0 if row["type"] == "float64" else 2))
    changed = message.dump()
    setattr(message, field, before)
    place = next(at for at, pair in enumerate(zip(zero, changed, strict=True)) if len({*pair}) > 1)
    return place - (7 if row["type"] == "float64" else 0)  # 2.0 is 00 00 00 00 00 00 00 40


def usual_state(n: int) -> State:
    """As a robot of ours without sensors sends it; all of it 0."""
    state = State(n, reference_rate=n, reference_acceleration=n, followed=1)
    state.followed[:] = 0.0
    return state


MAKERS = {
    "State": usual_state,
    "Setpoint": lambda n: Setpoint(n, decision=n),
    "Event": lambda n: Event(),
    "Target": lambda n: Target(n, 1, rates=1),
}


@pytest.mark.parametrize("kind", MAKERS)
@pytest.mark.parametrize("n", [1, 3, 21, 128])
def test_the_offsets_of_the_tables_are_those_of_the_code(kind, n):
    rows = table(section(kind), "field")
    message = MAKERS[kind](n)
    for row in rows:
        stated, expected = offset(row["offset"], n), found_offset(message, row)
        if expected is None:  # where it would begin, if it were the only one behind
            name = row["field"]
            expected = found_offset(type(message).allocate(**lengths_with(message, name)), row)
        assert stated == expected, row["field"]
        assert n != 21 or "n = 21" not in row or int(row["n = 21"]) == expected, row["field"]


def lengths_with(message: Message, name: str) -> dict[str, int]:
    """Lengths of the message's arrays, with one number in the array called `name`."""
    return {**message.schema.lengths_in(message.dump()), name: 1}


@pytest.mark.parametrize(("sensors", "extras"), [(1, 1), (2, 5)])
def test_sensors_and_extras_begin_where_the_tables_say(sensors, extras):
    for kind, message, name in (
        ("State", State(3, 6 * sensors), "wrench"),
        ("Setpoint", Setpoint(3, extras), "extra"),
    ):
        (row,) = [row for row in table(section(kind), "field") if row["field"] == name]
        assert offset(row["offset"], 3) == found_offset(message, row)


@pytest.mark.parametrize("kind", MAKERS)
def test_the_tables_name_every_field_with_its_type_in_order(kind):
    schema = MAKERS[kind](1).schema
    expected = list(schema.scalars.items())
    for name in schema.arrays:
        expected += [(f"length of {name}", "uint32"), (name, "float64[]")]
    assert [(row["field"], row["type"]) for row in table(section(kind), "field")] == expected


@pytest.mark.parametrize("kind", MAKERS)
def test_units_are_those_of_the_schema(kind):
    """Each unit word of a table stands in the comment of the field, or stamps are in ns."""
    text = MAKERS[kind](1).schema.text
    plain = text.replace("s2", "s²")
    for row in table(section(kind), "field"):
        if not row["unit"]:
            continue
        line = next(line for line in plain.splitlines() if re.search(rf"\b{row['field']}\b", line))
        if row["unit"] == "ns":
            assert row["field"].startswith("stamp")
            continue
        for unit in re.split(r", | or | and ", row["unit"]):
            assert unit in line, (row["field"], unit)


def test_the_sizes_of_the_text_are_those_of_the_code():
    for kind in ("State", "Setpoint"):
        formula, of_21 = re.search(
            r"(\d+ \+ \d+n) bytes[,:] (\d+) for n = 21", section(kind)
        ).groups()
        for n in (1, 21, 128):
            assert offset(formula, n) == MAKERS[kind](n).size
        assert int(of_21) == MAKERS[kind](21).size
    assert section("Event").strip().startswith(f"{Event().size} bytes")
    assert f"{Target(0, 3).size} bytes and 8pd" in section("Target")


def test_the_longest_arrays_are_those_of_the_code():
    found = {row["array"]: int(row["numbers"]) for row in table(section("Setpoint"), "array")}
    assert found == MAX_LENGTHS


def test_modes_events_and_reasons_have_the_numbers_of_the_code():
    modes = {row["State.mode"]: int(row["value"]) for row in table(PAGE, "`State.mode`")}
    assert modes == {
        name: getattr(State, name) for name in ("IDLE", "ACTIVE", "STOPPING", "STOPPED")
    }
    kinds = table(section("Event"), "`kind` | value")
    assert {row["kind"]: int(row["value"]) for row in kinds}.items() <= EVENTS.items()
    (stop,) = [row["detail"] for row in kinds if row["kind"] == "SAFE_STOP"]
    told = [(int(number), word) for number, word in re.findall(r"(\d) (\w+)", stop)]
    reasons = {name: value for name, value in EVENTS.items() if name.startswith("REASON_")}
    assert [number for number, _ in told] == sorted(reasons.values())
    words = ("MISSES", "HOLDER_LOST", "COMMAND", "SHUTDOWN", "RELEASED", "ENDED")
    assert [reasons[f"REASON_{word}"] for word in words] == [number for number, _ in told]


def test_the_reasons_of_refusals_are_numbered_as_in_the_code():
    rows = table(section("What is refused"), "number")
    assert [(int(row["number"]), row["reason"]) for row in rows] == list(enumerate(REJECTION_KINDS))


def test_figures_in_the_text_are_those_of_the_code():
    text = " ".join(PAGE.split())
    assert f"{HISTORY} or more ticks ago" in text
    assert f"{GRACE_TICKS} ticks later in real time" in text
    assert f"after {EmulatorConfig().misses_to_stop} consecutive misses" in text
    assert f"listens on `{EmulatorConfig().link.listen[0]}` only" in text
    assert f"`link.lease_ms`, {EmulatorConfig().link.lease_ms // 1000} s" in text


class Robot:
    """A whole robot in lockstep, in process or over Zenoh."""

    def __init__(self, clock: Clock, link: object, **config: object) -> None:
        settings = EmulatorConfig(robot="arm", **config)
        description = arm()
        self.loop = RobotLoop(
            description,
            settings,
            clock,
            link,
            NoRecorder(),
            session_id=2**63 - 1,
            grace_ticks=0 if isinstance(clock, VirtualClock) else GRACE_TICKS,
        )


def test_requests_are_answered_as_the_table_says():
    clock = VirtualClock()
    link = LockstepLink(lambda state: None, clock)
    robot = Robot(clock, link)
    asked = [
        ("description", "a"),
        ("config", "a"),
        ("status", "a"),
        ("acquire", "a"),
        ("acquire", "b"),
        ("release", "b"),
        ("release", "a"),
        ("stop", "b"),
        ("recover", "b"),
        ("recover", "b"),
        ("dance", "a"),
    ]
    answers = [link.ask(*each) for each in asked]
    robot.loop.run(0, lambda: clock.now() > 5_000_000)
    found = [answer for (answer,) in answers]
    assert EmulatorConfig.model_validate_json(found.pop(1)).robot == "arm"
    status = set(json.loads(re.search(r"```json\n(.*?)```", PAGE, re.DOTALL)[1]))
    description = json.loads(found[0])
    keys = {*description, *description["joints"][0]}
    words = {*get_args(CommandKind), *get_args(Gravity)}
    words |= {"default_task", *DefaultTask.model_fields}  # which this robot does not have
    words |= {"deadline", "delay_ticks", "servo_rate_1_s", *get_args(DeadlineRule)}
    words |= {"state_arrays", "wrench", "setpoint_jerk_max"}
    named = set(re.findall(r"`(\w+)`", section("Asking").split("The description is")[1]))
    assert keys <= named <= keys | words
    assert set(found[1]) == status | {"counts"}
    assert all(f"`{name}`" in section("Asking") for name in found[1]["counts"])
    terms = {"deadline", "delay_ticks", "setpoint_arrays"}
    assert set(found[2]) == {"granted", "epoch", "from_tick"} | terms | status
    assert set(found[3]) == {"granted", "reason"} | status
    assert found[3]["reason"] == "held"
    assert (found[2]["granted"], found[3]["granted"], found[3]["holder"]) == (True, False, "a")
    assert (found[4], found[5]) == ({"released": False}, {"released": True})
    assert set(found[6]) == status
    assert set(found[7]) == set(found[8]) == {"recovered"} | status
    assert (found[7]["recovered"], found[8]["recovered"]) == (True, False)
    assert list(found[9]) == ["error"]


@pytest.fixture
def network() -> Iterator[Network]:
    made = Network()
    yield made
    made.close()


@pytest.mark.parametrize("lockstep", [True, False])
def test_the_client_of_the_page_follows_a_robot(network, tmp_path, lockstep):
    (program,) = re.findall(r"```python\n(import json.*?)```", PAGE, re.DOTALL)
    (tmp_path / "client.py").write_text(program, encoding="utf-8")
    endpoint, ended = free_endpoint(), threading.Event()
    settings = LinkSettings(listen=(endpoint,), lease_ms=30_000)
    if lockstep:
        clock = VirtualClock()
        link = network.keep(
            RemoteLockstepLink(
                ZenohRobotLink("arm", settings, blocking=True),
                clock,
                200_000,
                ended.is_set,
                endless=True,
            )
        )
        robot = Robot(clock, link)
    else:  # in the process of the tests nothing is real time: misses are all right
        clock = MonotonicClock()
        robot = Robot(clock, network.robot(**settings.model_dump()), misses_to_stop=10**9)
    running = network.start(robot.loop.run, clock.now(), ended.is_set)
    try:
        done = subprocess.run(
            [sys.executable, str(tmp_path / "client.py"), endpoint, "arm"],
            capture_output=True,
            timeout=PATIENCE_S,
            check=False,
            text=True,
        )
    finally:
        ended.set()
    running.result(PATIENCE_S)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == {"answered": 200, "released": True}
    counts = robot.loop.summary()
    assert counts["rejections"] == {}
    assert counts["safe_stops"] == 0
    if lockstep:  # `release` may come in time for the next tick, or while that waits
        assert counts["in_time"] == 200
        assert counts["asked"] in {200, 201}


def test_the_join_example_is_a_config_that_zenoh_takes():
    import zenoh

    text = re.search(r'from_json5\("""(.*?)"""\)', PAGE, re.DOTALL)[1]
    config = zenoh.Config.from_json5(text)
    assert json.loads(config.get_json("mode")) == "client"
