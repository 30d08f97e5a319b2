"""The remote controller as a service: waits for its robot, answers it, survives its absence."""

from __future__ import annotations

import math
import os
import secrets
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from hoap3.protocol.answers import GrantAnswer, Status, parse_answer, parse_description
from hoap3.protocol.errors import (
    AuthorityError,
    Hoap3Error,
    LinkError,
    PortInUseError,
    UsageError,
    WireError,
)
from hoap3.protocol.link.base import Request
from hoap3.protocol.link.hoap3_tcp.controller_link import Hoap3ControllerLink
from hoap3.protocol.link.local_control import others_here
from hoap3.protocol.link.zenoh_link import ZenohControllerLink
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.clock import Clock, MonotonicClock, VirtualClock
from hoap3.protocol.runtime.notes import Detail, Routine, told
from hoap3.protocol.runtime.numba_jit import warm_up
from hoap3.protocol.runtime.realtime import prepare_process
from hoap3.protocol.runtime.recorder import Recorder
from hoap3.protocol.secure.credentials import read_credentials
from hoap3.protocol.secure.refusals import why_refused
from hoap3.protocol.stop_reasons import recovery_words, stop_words, waits_for_recovery
from hoap3.remote_controller.config import ControllerConfig, build
from hoap3.remote_controller.config_exchange import is_config, own_config
from hoap3.remote_controller.controllers.base import Controller
from hoap3.remote_controller.loop import ARRAYS, ControllerLoop, checked_step, failure
from hoap3.remote_controller.outcome import Outcome
from hoap3.remote_controller.registry import find
from hoap3.remote_controller.silence import SilenceWatch

KERNELS = (
    "hoap3.remote_controller.solvers.qp12.qp12_kernels",
    "hoap3.remote_controller.solvers.qp12.pinv_kernels",
    "hoap3.remote_controller.model.kinematics_kernels",
    "hoap3.protocol.robot.mimic_joints_kernels",
    "hoap3.remote_controller.controllers.qp12.lyapunov_descent_kernels",
)
REHEARSALS = 200
RETRY_S = 0.2
SILENCE_S = 3.0
"""Without a State or an answer, after which a new Zenoh session is opened: three leases, in which
Zenoh could have connected again by itself. A session that was cut in a flood may never do so."""

Link = ZenohControllerLink | Hoap3ControllerLink

OPERATES = ("acquire", "release")  # what an operator asks of a controller

KNOWN_NAMES = 64  # of our last sessions: a robot forgets those that have ended within a lease
TOKEN_TRIES = 25  # how often authority is asked for while the robot does not see our token


def prepare(report: Callable[[str], None], own: Sequence[str] = ()) -> None:
    """Import and compile whatever is slow to, before anything is real time.

    Args:
        report: takes what is done.
        own: modules that the controller needs besides.
    """
    import pinocchio  # noqa: F401 - half a second, better now than in the loop

    warm_up((*KERNELS, *own), lambda name: report(Detail(f"kernels: {name}")))


def rehearse(controller: Controller, description: RobotDescription) -> None:
    """Step through the start posture until nothing happens for the first time.

    Raises:
        Hoap3Error: the controller failed.
    """
    state = State.allocate(**description.state_lengths)
    state.q[:] = state.reference[:] = description.initial_position
    arrays = ARRAYS(controller.command)
    try:
        controller.reset(state, None)
        for tick in range(REHEARSALS):
            state.tick = tick
            checked_step(controller, arrays, state, state.dump())
    except (Exception, SystemExit) as error:  # nobody else may end us
        what = f"failed when it rehearsed with robot {description.name!r}, {description.n} joints"
        raise failure(controller, what, error) from error


def serve(request: Request, loop: ControllerLoop, about: bytes = b"") -> None:
    """Do what somebody asks of the controller, between two samples, and answer.

    Args:
        request: what is asked.
        loop: that answers the robot.
        about: answer to those who ask what the controller is; see `ControllerLoop.about`.

    Raises:
        Hoap3Error: the controller failed.
    """
    if request.verb == "about":
        request.answer(about)
        loop.note_request(request, None)
        return
    try:
        if request.verb in OPERATES:
            now = loop.operate(request.verb, request.who)
        elif request.verb == "tasks":
            outcome = loop.outcome()
            operator = loop.steering.operator or None
            now = {"tasks": outcome["tasks"], "operator": operator, "outcome": outcome}
        else:
            if request.verb == "change":
                loop.change(request.body)
            now = loop.changeable()
        answer: dict[str, Any] = {"error": None, "now": now}
    except UsageError as error:
        answer = {"error": str(error), "now": None}
    request.answer(answer)
    loop.note_request(request, answer["error"])


class Service:
    """Runs one configured controller against one robot.

    Args:
        config, file: of the controller, and where it was read.
        recorder: where the log goes.
        report: takes what people should know.
        should_stop: asked at each sample.
        lockstep_recorder: where the log goes in lockstep, and nothing of it may be lost.
        on_stop: takes what is to be called when an end is asked for while no sample comes.
        description: of the robot, for a link that does not tell it.

    Attributes:
        loop: of the newest session of the robot, or None.
        unusable: how many answers of the robot were not what they should be.
        sessions: how many Zenoh sessions were opened.
    """

    def __init__(
        self,
        config: ControllerConfig,
        recorder: Recorder,
        report: Callable[[str], None],
        should_stop: Callable[[], bool],
        file: str = "config",
        lockstep_recorder: Recorder | None = None,
        on_stop: Callable[[Callable[[], None]], None] | None = None,
        description: RobotDescription | None = None,
    ) -> None:
        self._config, self._file = config, file
        self._config_json = own_config(config)  # for those who ask about it
        self._about = b""
        self._recorder, self._report, self._should_stop = recorder, report, should_stop
        self._lockstep_recorder = lockstep_recorder or recorder
        self._on_stop, self._description = on_stop, description
        self._digest = ""
        self._departures = 0
        self._controller: Controller | None = None
        self._outcome: Outcome | None = None  # over all engagements in a session of the robot
        self._session_id: int | None = None
        self._clock: Clock = MonotonicClock()
        name = config.controller.replace(":", ".").rsplit(".", 1)[-1].lower()
        own = f"{os.getpid()}-{secrets.token_hex(3)}"  # in each container there is a process 1
        self._name = f"{name[:20]}-{own}-{socket.gethostname()[:20]}".replace("/", "-")
        if config.link.secure is not None:
            self._name = read_credentials(config.link.secure).session_name(f"{name[:12]}-{own}")
        self._names: deque[str] = deque(maxlen=KNOWN_NAMES)  # of our sessions
        self._link: Link | None = None
        self._stopping = threading.Event()
        self._unanswered_since = math.inf
        self._told: set[str] = set()  # since it last followed the robot
        self.loop: ControllerLoop | None = None
        self.unusable = self.sessions = 0
        self._followed_before_s = 0.0  # with loops of earlier sessions

    def run(self, duration: float | None = None) -> None:
        """Answer the robot until told to stop; authority is given back at an orderly end.

        It also ends when it has followed the robot for `duration` [s of the robot's time].

        Where the controller fails, it is not: the robot finds its holder gone, and stops safely.

        Raises:
            AuthorityError: the robot follows another controller, or never sees our token.
            ConfigError: the controller does not fit the robot.
        """
        prepare(self._report, find(self._config.controller, self._file).kernels)
        for note in told(prepare_process(self._config.realtime)):
            self._report(note)
        if self._on_stop is not None:
            self._on_stop(self._wake)
        if duration is not None:
            asked = self._should_stop
            self._should_stop = lambda: asked() or self._followed_s() >= duration
        while not self._should_stop():
            self._link = self._open()
            if self._link is None:
                self._pause()
                continue
            try:
                self._use(self._link)
            finally:
                self._link.close()
        if self.unusable:
            self._report(f"{self.unusable} answers of robot {self._config.robot!r} were unusable")

    def _followed_s(self) -> float:
        """How long robots have been followed, in all sessions [s of their time]."""
        loop, controller = self.loop, self._controller
        newest = loop.steps * controller.description.period_s if loop and controller else 0.0
        return self._followed_before_s + newest

    def _begin_session(self) -> None:
        """Count what the loop of the last session has followed, and forget that loop."""
        self._followed_before_s, self.loop = self._followed_s(), None

    def _wake(self) -> None:
        """Have whatever waits look whether it shall stop; from any thread."""
        self._stopping.set()
        link = self._link
        if link is not None:
            link.wake()

    def _pause(self) -> None:
        self._stopping.wait(RETRY_S)

    def _open(self) -> Link | None:
        """A new session, under a name of its own: the robot may still know the last one.

        Returns:
            None where it cannot be opened now, though it could before.
        """
        self.sessions += 1
        self._unanswered_since = math.inf
        who = self._name if self.sessions == 1 else f"{self._name}-{self.sessions}"
        self._names.append(who)
        try:
            settings = self._config.link
            if self._description is not None:
                return Hoap3ControllerLink(self._description, settings.hoap3_tcp, who)
            return ZenohControllerLink(self._config.robot, settings, who)
        except (LinkError, PortInUseError) as error:
            if self.sessions == 1:
                raise
            self._tell_once("closed", str(error))
            return None

    def _use(self, link: Link) -> None:
        """Join and follow the robot, again and again, until it falls silent or we shall stop."""
        while self._join(link) and self._follow(link):
            if self._should_stop():
                break
        if self._should_stop() and link.presence.is_set():
            link.ask("release")

    def _join(self, link: Link) -> bool:
        """Wait for the robot, build the controller that it needs, get authority.

        Returns:
            False where the robot has been silent for too long, or we are told to stop.
        """
        self._departures = link.departures
        endpoints = ", ".join(self._config.link.places)
        while not self._should_stop():
            try:
                if self._engage(link):
                    self._told.clear()
                    return True
            except WireError as error:
                self._count(error)
            if self._unanswered_since < math.inf:
                self._tell_waiting(link.robot, endpoints)
            if link.linked and time.monotonic() - self._unanswered_since >= SILENCE_S:
                self._tell_once(
                    "silent", f"robot {link.robot!r} does not answer: trying a new session"
                )
                return False
            self._pause()
        return False

    def _ask(self, link: Link, verb: str, body: bytes = b"") -> bytes | None:
        """Ask the robot, and note since when it has not answered."""
        asked = time.monotonic()
        answer = link.ask(verb, body=body)
        self._unanswered_since = min(self._unanswered_since, asked) if answer is None else math.inf
        return answer

    def _count(self, error: WireError) -> None:
        """An answer that cannot be used: the robot is asked again."""
        self.unusable += 1
        self._tell_once("unusable", f"{error}; asking again")

    def _tell_waiting(self, robot: str, endpoints: str) -> None:
        """Report what is waited for, and which robots there are instead."""
        if "waiting" in self._told:
            return
        text = f"waiting for robot {robot!r} at {endpoints}{self._why_refused(robot)}"
        others = others_here(robot)
        self._tell_once("waiting", Routine(f"{text}; {others}" if others else text))

    def _why_refused(self, robot: str) -> str:
        """With a certificate, what a handshake tells; "" without one."""
        link = self._config.link
        if link.secure is None or not link.connect:
            return ""
        try:
            ours = read_credentials(link.secure)
            why = why_refused(link.connect[0], ours, robot)
        except (Hoap3Error, OSError) as error:  # it may be renewed at this moment
            return f": {error}"
        return f": {why}; its access.yaml must list {ours.name!r} as {ours.role}"

    def _tell_once(self, what: str, text: str) -> None:
        """Report something, unless the like was reported since the robot was last followed."""
        if what not in self._told:
            self._told.add(what)
            self._report(text)

    def _engage(self, link: Link) -> bool:
        """One attempt to get what is needed from the robot.

        Raises:
            WireError: an answer that cannot be used.
        """
        conflict = "" if isinstance(link, Hoap3ControllerLink) else link.name_conflict()
        if conflict:
            self._tell_once("conflict", f"{conflict}. Waiting until one is left")
            return False
        data = self._ask(link, "description")
        if data is None:
            return False
        description = parse_description(data, link.robot)
        raw = self._ask(link, "status")
        if raw is None:
            return False
        status = parse_answer(Status, raw, f"robot {link.robot!r} answers 'status'")
        self._begin_session()
        if self._controller is None or description.digest != self._digest:
            self._controller = build(self._config, description, self._file)
            self._digest, self._outcome = description.digest, None
            for note in self._controller.notes():
                self._report(note)
        if self._outcome is None or status.session_id != self._session_id:
            self._outcome = Outcome(self._controller, description)
            self._session_id = status.session_id
        link.session_id = status.session_id
        self._clock = VirtualClock() if status.lockstep else MonotonicClock()
        rehearse(self._controller, description)
        recorder = self._lockstep_recorder if status.lockstep else self._recorder
        loop = ControllerLoop(
            self._controller, self._clock, recorder, status.session_id, self._outcome
        )
        loop.begin(description, lockstep=status.lockstep)
        if not isinstance(link, Hoap3ControllerLink):
            loop.note_token(present=True)
        config = self._ask_config(link)
        if config is not None:
            loop.note_config(config)
        self._about = loop.about(self._config_json)
        self.loop = loop
        grant = self._acquire(link)
        if grant is None or grant.epoch is None or not loop.claim.fits(grant.session_id):
            return False
        self._check_lengths(grant, link)
        loop.grant(grant.epoch)
        loop.announce("ROBOT_FOUND", grant.epoch)
        if waits_for_recovery(grant.mode, grant.stop_reason):
            remedy = recovery_words(link.robot, self._config.link.connect[0])
            stands = f"{stop_words(grant.stop_reason)}; {remedy}"
            self._report(f"following robot {link.robot!r}, which does not move: {stands}")
        else:
            self._report(Routine(f"following robot {link.robot!r} from tick {grant.from_tick}"))
        return True

    def _ask_config(self, link: Link) -> bytes | None:
        """The robot's configuration, a JSON object; None where it does not tell."""
        if isinstance(link, Hoap3ControllerLink):
            return None
        raw = self._ask(link, "config")
        return raw if raw is not None and is_config(raw) else None

    def _check_lengths(self, grant: GrantAnswer, link: Link) -> None:
        """Give authority back where the robot has no room for the controller's setpoints.

        Raises:
            UsageError: names the array, its length, and what the robot takes.
        """
        if self._controller is None:
            return
        for name in Setpoint.schema.arrays:
            length = len(getattr(self._controller.command, name))
            most = grant.setpoint_arrays.get(name, length)
            if length > most:
                link.ask("release")
                raise UsageError(
                    f"controller {self._config.controller!r} sends {length} numbers as {name!r}, "
                    f"and robot {self._config.robot!r} takes {most}. Send fewer"
                )

    def _acquire(self, link: Link) -> GrantAnswer | None:
        """Ask for authority, again where the answer is unusable or the refusal will pass.

        It passes once the robot sees our token, or no longer that of our last session.

        Returns:
            The grant, or None where the robot does not answer or we are told to stop.

        Raises:
            AuthorityError: the robot follows another controller, or never sees our token.
        """
        unseen = 0
        while not self._should_stop():
            raw = self._ask(link, "acquire", own_config(self._config))
            if raw is None:
                return None
            try:
                grant = parse_answer(GrantAnswer, raw, f"robot {link.robot!r} answers 'acquire'")
            except WireError as error:
                self._count(error)
                self._pause()
                continue
            if grant.granted:
                return grant
            if grant.reason == "name_taken":
                taken = f"robot {link.robot!r} grants no authority: another robot uses its name"
                conflict = "" if isinstance(link, Hoap3ControllerLink) else link.name_conflict()
                self._tell_once("conflict", f"{conflict or taken}. Waiting until one is left")
                return None
            if grant.holder is None or grant.reason == "no_token":
                unseen += 1
                if unseen >= TOKEN_TRIES:
                    raise AuthorityError(link.robot, grant.holder)
            elif grant.holder not in self._names:
                raise AuthorityError(link.robot, grant.holder)
            why = f"{grant.reason}; it follows {grant.holder or 'no controller'}"
            waits = f"waiting for authority over robot {link.robot!r} ({why})"
            self._tell_once("authority", Routine(waits))
            self._pause()
        return None

    def _follow(self, link: Link) -> bool:
        """Answer samples until the robot goes, starts anew, falls silent, or we shall stop.

        Returns:
            False where it fell silent: this session may be of no more use.
        """
        loop = self.loop
        if loop is None:
            return True
        wait, publish, asked = link.wait, link.publish, link.request
        answer, sent, event = loop.answer, loop.sent, link.event
        silent = False
        with SilenceWatch(lambda: loop.steps, link.wake, SILENCE_S) as watch:
            while not self._should_stop():
                arrival = wait()
                if link.departures != self._departures:
                    break
                if arrival is None:
                    silent = watch.silent() and not self._stands_still(link)
                    if silent:
                        break
                    continue
                setpoint = answer(*arrival)
                if setpoint is not None:
                    publish(setpoint)
                sent()
                told = event()  # one for each State: others may send more than can be read
                if told is not None:
                    loop.receive_event(told)
                request = asked()
                if request is not None:
                    serve(request, loop, self._about)
                    watch.reset()
                self._report_not_finite(loop)
                if loop.steered:
                    self._hear_senders(link, loop)
                if loop.stale:
                    break
            else:
                self._sum_up(loop)
                return True
        self._sum_up(loop)
        loop.announce("ROBOT_LOST", loop.last_tick)
        if not isinstance(link, Hoap3ControllerLink):
            loop.note_token(present=link.presence.is_set())
        gone = "is silent" if silent else "no longer follows us" if loop.stale else "is gone"
        note = f"robot {link.robot!r} {gone}"
        self._report(note if silent else Routine(note))
        return not silent

    def _sum_up(self, loop: ControllerLoop) -> None:
        loop.sum_up()
        if loop.steered:
            self._report(Routine(str(loop.steering)))
        if ignored := loop.ignored():
            self._report(f"ignored messages: {ignored}")

    def _report_not_finite(self, loop: ControllerLoop) -> None:
        if loop.not_finite:
            self._tell_once("not finite", loop.not_finite)

    def _hear_senders(self, link: Link, loop: ControllerLoop) -> None:
        """Take a Target, and note an operator that vanished; one for each State, as above."""
        target, gone = link.target(), link.vanished()
        if target is not None:
            loop.steer(*target)
        if gone is not None and loop.steering.release(gone):
            self._report(Routine(f"{gone!r}, which steered, is gone"))

    def _stands_still(self, link: Link) -> bool:
        """Whether no State comes because the robot sends none: no new session would change that.

        HOAP-3's protocol has none at rest, and in virtual time there may be none for any time.
        """
        if isinstance(link, Hoap3ControllerLink):
            return True
        if not isinstance(self._clock, VirtualClock):
            return False
        raw = self._ask(link, "status")
        if raw is None:
            return False
        try:
            parse_answer(Status, raw, f"robot {link.robot!r} answers 'status'")
        except WireError as error:
            self._count(error)
        return True
