"""The robot emulator as a service: one robot, one link, until it is told to stop."""

from __future__ import annotations

import json
import secrets
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager

from hoap3.protocol.answers import Status
from hoap3.protocol.config.endpoints import beyond_this_machine
from hoap3.protocol.errors import ConfigError, DescriptionError
from hoap3.protocol.link.base import RemoteRobotLink, RobotLink
from hoap3.protocol.link.local_control import LocalControl, local_robots
from hoap3.protocol.link.remote_lockstep import RemoteLockstepLink
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.clock import Clock, MonotonicClock, VirtualClock
from hoap3.protocol.runtime.notes import Detail, Routine, told
from hoap3.protocol.runtime.private_directory import no_directory
from hoap3.protocol.runtime.realtime import Measure, prepare_process, schedule_start
from hoap3.protocol.runtime.recorder import Recorder
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.filters.jerk import jerk_notes
from hoap3.robot_emulator.loop import GRACE_TICKS, RobotLoop
from hoap3.robot_emulator.plants.registry import declared, find_plant
from hoap3.robot_emulator.robots import load_configured
from hoap3.robot_emulator.robots.mimic_limits import mimic_joint_notes

KERNELS = (
    "hoap3.robot_emulator.plants.motion_kernels",
    "hoap3.robot_emulator.filters.position_kernels",
    "hoap3.robot_emulator.filters.jerk_kernels",
    "hoap3.protocol.limits.viability_bounds_kernels",
    "hoap3.protocol.robot.mimic_joints_kernels",
)
CONTACT_KERNELS = ("hoap3.robot_emulator.plants.contact_kernels",)
GIVEN = "given values"  # name of a start posture that the config gives as joint values
LEAD = 4  # the part of a period that a robot in real time may act ahead of a tick


def describe(
    config: EmulatorConfig, file: str = "config", robot: RobotDescription | None = None
) -> RobotDescription:
    """Description of the configured robot: its name, start posture and command as configured.

    A plant that is named takes what it can: of a robot in a simulation that may be more than the
    robot's own motors are told.

    Args:
        config, file: settings, and where they stand, for errors.
        robot: what `config.robot` names, if it was read already.

    Raises:
        UsageError: there is no such robot, or it has not what is configured.
    """
    description = robot or load_configured(config.robot, file, config.tip, config.lock_joints)
    description.check_moves()
    if isinstance(config.posture, str):
        if config.posture not in description.postures:
            known = f"Known: {', '.join(sorted(description.postures))}"
            raise ConfigError(file, "posture", config.posture, "no such posture", known)
        description = description.model_copy(update={"initial_posture": config.posture})
    elif config.posture is not None:
        postures = {**description.postures, GIVEN: config.posture}
        start = {"postures": postures, "initial_posture": GIVEN}
        try:
            description = description.model_copy(update=start)
        except DescriptionError as error:
            remedy = f"Joints: {', '.join(description.joint_names)}"
            raise ConfigError(file, "posture", config.posture, str(error), remedy) from error
    if config.name is not None:
        description = description.model_copy(update={"name": config.name})
    if config.setpoint_jerk_max is not None:
        change = {"setpoint_jerk_max": config.setpoint_jerk_max}
        joints = tuple(joint.model_copy(update=change) for joint in description.joints)
        description = description.model_copy(update={"joints": joints})
    kind = config.command or description.command_kinds[0]
    if kind not in description.command_kinds and config.plant.kind is None:
        takes = " or ".join(description.command_kinds)
        raise ConfigError(file, "command", kind, f"{config.robot} takes {takes}", "Choose that")
    _check_fit(config, kind, file)
    plant = declared(description, config.plant, kind, file)
    return description.model_copy(
        update={
            "command_kinds": (kind,),
            "gravity": config.plant.gravity,
            "deadline": config.deadline,
            "delay_ticks": config.delay_ticks,
            "servo_rate_1_s": plant["servo_rate_1_s"],
            "joints": plant["joints"],
            "state_arrays": {
                "reference_rate": description.n,
                "reference_acceleration": description.n,
                "followed": 1,
                **plant["state_arrays"],
            },
        }
    )


def _check_fit(config: EmulatorConfig, kind: str, file: str) -> None:
    """Refuse settings that are for positions where the robot takes none."""
    if kind == "position":
        return
    if config.link.kind == "hoap3_tcp":
        problem = f"carries positions, and this robot takes {kind}"
        raise ConfigError(file, "link.kind", config.link.kind, problem, "Write zenoh")
    if config.loss_policy != "hold":
        problem = f"is for position commands, not {kind}"
        raise ConfigError(file, "loss_policy", config.loss_policy, problem, "Write hold")


def build_loop(
    config: EmulatorConfig,
    description: RobotDescription,
    clock: Clock,
    link: RobotLink,
    recorder: Recorder,
    *,
    lockstep: bool,
    session_id: int | None = None,
) -> RobotLoop:
    """A robot that is ready to run, and the first records of its log."""
    session_id = config.seed if session_id is None else session_id
    session = {"side": "robot", "session_id": session_id, "lockstep": lockstep}
    recorder.record(Kind.DESCRIPTION, clock.now(), description.to_json())
    recorder.record(Kind.SESSION, clock.now(), json.dumps(session).encode())
    return RobotLoop(
        description,
        config,
        clock,
        link,
        recorder,
        session_id,
        grace_ticks=0 if lockstep else GRACE_TICKS,
        lead=0 if lockstep else round(description.period_s * 1e9) // LEAD,
    )


def serve(
    config: EmulatorConfig,
    description: RobotDescription,
    recorder: Recorder,
    report: Callable[[str], None],
    should_stop: Callable[[], bool],
    ticks: int | None = None,
    *,
    lockstep: bool = False,
) -> RobotLoop:
    """Run a robot over its link until told to stop, or for `ticks`.

    Args:
        config, description: of the robot.
        recorder: where its log goes.
        report: takes what happened at the start, for people.
        should_stop: asked at each tick; the robot then comes to rest first.
        ticks: duration counted from the first active tick, or None.
        lockstep: run on virtual time: each State waits for its answer, however long that takes.

    Raises:
        NameTakenError, PortInUseError, LinkError: it could not join the network; or in lockstep
            the controller did not answer for ten seconds; names the tick.
    """
    session_id = config.seed if lockstep else secrets.randbits(63)
    with closing(_while_starting(config, description, session_id, lockstep=lockstep)) as starting:
        measures = [] if lockstep else _prepare_process(config, description, report)
        for note in (*mimic_joint_notes(description), *jerk_notes(description), *told(measures)):
            report(note)
        reached = _open_link(config, description, report, session_id, blocking=lockstep)
        link: RemoteRobotLink | RemoteLockstepLink = reached
        clock: Clock = MonotonicClock()
        if lockstep:
            clock = virtual = VirtualClock()
            compute_time = round(config.lockstep.compute_time_us * 1e3)
            endless = ticks is None
            link = RemoteLockstepLink(reached, virtual, compute_time, should_stop, endless=endless)
        with closing(link):
            loop = build_loop(
                config, description, clock, link, recorder, lockstep=lockstep, session_id=session_id
            )
            loop.realtime = [str(measure) for measure in measures]
            for line in loop.plant.notes():
                report(line)
            starting.close()
            how = ", lockstep" if lockstep else ""
            with _local_control(link, config, description, report, how):
                start = 0 if lockstep else schedule_start(clock, loop.period)
                loop.run(start, should_stop, ticks)
    return loop


def _prepare_process(
    config: EmulatorConfig, description: RobotDescription, report: Callable[[str], None]
) -> list[Measure]:
    """Compile kernels, and ask the operating system for what real time needs."""
    from hoap3.protocol.runtime.numba_jit import warm_up

    contact = CONTACT_KERNELS if config.plant.contacts else ()
    plant = find_plant(config.plant, description.command_kinds[0])[0]
    warm_up((*KERNELS, *contact, *plant.kernels), lambda name: report(Detail(f"kernels: {name}")))
    return prepare_process(config.realtime)


def _open_link(
    config: EmulatorConfig,
    description: RobotDescription,
    report: Callable[[str], None],
    session_id: int,
    *,
    blocking: bool = False,
) -> RemoteRobotLink:
    """The configured link to controllers; `blocking` for lockstep."""
    open_to_all = [place for place in config.link.reachable if beyond_this_machine(place)]
    if open_to_all and config.link.secure is None:
        report(f"insecure: whoever reaches {', '.join(open_to_all)} can command this robot")
    if config.link.kind == "hoap3_tcp":
        from hoap3.protocol.link.hoap3_tcp.robot_link import Hoap3RobotLink

        return Hoap3RobotLink(description, config.link.hoap3_tcp, report, blocking=blocking)
    from hoap3.protocol.link.zenoh_link import ZenohRobotLink

    return ZenohRobotLink(
        description.name, config.link, blocking=blocking, report=report, session_id=session_id
    )


def _while_starting(
    config: EmulatorConfig, description: RobotDescription, session_id: int, *, lockstep: bool
) -> LocalControl:
    """The local control until the loop can serve requests.

    It has a thread of its own, with ordinary rights: that of the loop is started after
    `prepare_process`, so that it runs with the loop's priority.
    """
    status = Status(mode="starting", holder=None, session_id=session_id, tick=0, lockstep=lockstep)
    return LocalControl(description.name, config.link.places, status.model_dump())


@contextmanager
def _local_control(
    link: RemoteRobotLink | RemoteLockstepLink,
    config: EmulatorConfig,
    description: RobotDescription,
    report: Callable[[str], None],
    how: str = "",
) -> Iterator[None]:
    """Serve what `hoap3 stop` reaches on this machine even where the network does not answer."""
    same = [str(one) for one in local_robots() if one.name == description.name]
    if same:
        report(
            f"another robot of this user on this machine has the same name: {'; '.join(same)}. "
            f"`hoap3 stop {description.name}` stops both, other commands need --connect. To tell "
            "them apart, start this one with --set name=NAME"
        )
    with closing(LocalControl(description.name, config.link.places)) as local:
        if local.path is None:
            report(f"no local control: {no_directory()}")
        link.serve_also(local)
        endpoints = ", ".join(config.link.places)
        report(Routine(f"robot {description.name!r} is alive at {endpoints}{how}"))
        yield
