"""The controller's cycle: one State in, one Setpoint out, no timer of its own."""

from __future__ import annotations

import json
from dataclasses import replace
from math import isfinite
from operator import attrgetter, is_not
from typing import Any

from hoap3.protocol.config.plugins import blame
from hoap3.protocol.errors import Hoap3Error, UsageError, WireError
from hoap3.protocol.link.base import Request
from hoap3.protocol.messages import Event, FloatArray, Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.clock import Clock, VirtualClock
from hoap3.protocol.runtime.event_limit import EventLimit
from hoap3.protocol.runtime.recorder import Recorder
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.protocol.stop_reasons import LATCHING, STOP_REASONS
from hoap3.remote_controller.claim import Claim
from hoap3.remote_controller.controllers.base import STATUS, Controller
from hoap3.remote_controller.outcome import Outcome
from hoap3.remote_controller.steering import Steering

EVENTS = Event.schema.constants


LONGEST_CHANGE = 16_384  # bytes

RUN_UP = 3
"""Ticks before a grant begins at each of which the controller begins anew, as it will then: what it
does only at a beginning is slow where it has not just been done."""

HEARD_PAUSE_NS = 1_000_000_000
"""Between two records of the like that the robot said: anybody may publish in its name."""


def failure(controller: Controller, what: str, error: BaseException) -> Hoap3Error:
    """One clear error for whatever a controller raised; wrong usage stays what it is."""
    if isinstance(error, UsageError):
        return error
    kind = type(controller)
    return Hoap3Error(f"controller {kind.__name__} {what}: {blame(error, kind)}")


ARRAYS = attrgetter("values", "extra", "decision", "slacks", "gains", "next", "certificate")


def checked_step(
    controller: Controller, arrays: tuple[FloatArray, ...], state: State, payload: bytes
) -> Setpoint:
    """Step a controller, and check that it wrote into its own message alone.

    Args:
        controller, state: of the cycle.
        arrays: those of its command at the start, `ARRAYS(controller.command)`.
        payload: the State as it came.

    Raises:
        UsageError: it returned or wrote into something that is not sent, or changed the State.
    """
    command, name = controller.step(state), type(controller).__name__
    if command is not controller.command or any(map(is_not, ARRAYS(command), arrays)):
        raise UsageError(
            f"{name}.step: write into the existing message and its arrays, "
            "`self.command.values[:] = …`, `self.command.extra[:] = …`, and return `self.command`"
        )
    if state.dump() != payload:
        raise UsageError(
            f"{name}.step: it changed the State, which is read-only; work on a copy: "
            "`state.q.copy()`"
        )
    return command


class ControllerLoop:
    """One controller that answers one session of one robot.

    The order of what it records is the order in which it was processed, so that a replay can
    repeat it.

    Args:
        controller: the answers' author.
        clock, recorder: what it runs on.
        session_id: of the robot.
        outcome: counts of earlier engagements in this session, to go on with; None for new ones.

    Attributes:
        steering: who steers its live targets.
        steered: whether there are any.
        claim: authority under which it answers, if any.
        steps: States that the controller has processed.
        answered, overwritten, repeated, rejected, foreign: counts of States: answered, replaced by
            newer ones, received twice, malformed, of another session.
        rejected_events, foreign_events: counts of Events: malformed, of another session.
        summary: what the answers came to, as `Outcome.as_json` has it; None before the first
            `sum_up`.
        not_finite: the first answer with NaN or infinity that is no refusal, and the remedy, as
            text; "" where there was none.
    """

    def __init__(
        self,
        controller: Controller,
        clock: Clock,
        recorder: Recorder,
        session_id: int,
        outcome: Outcome | None = None,
    ) -> None:
        self._controller, self._clock, self._recorder = controller, clock, recorder
        self._arrays = ARRAYS(controller.command)
        controller.now = clock.now
        self._state = State.allocate(**controller.description.state_lengths)
        self._lockstep = isinstance(clock, VirtualClock)
        self.claim = Claim(session_id)
        self._event = Event()
        self._event.session_id = session_id
        self._request_limit = EventLimit(("about", "change", "show", "tasks"))
        self.steps = self.answered = self.overwritten = self.repeated = self.rejected = 0
        self.foreign = self.rejected_events = self.foreign_events = 0
        self.steering = Steering(controller.live, session_id, controller.description.period_s)
        self.steered, self._silent = bool(controller.live), False
        self._robot_event = Event()
        self._conflict_due = self._stop_due = 0  # when the next such word is recorded
        self._last_tick = -1
        self._last_answer: bytes | None = None
        self._engaged = self._started = False
        self._sent_previous = 0
        self._present = 0  # conditions of the last cycle
        self._unrecorded: list[tuple[Kind, int, bytes]] = []
        self._outcome = outcome or Outcome(controller, controller.description)
        self._summed_up = self._outcome.answers  # at the last `sum_up`
        self._noted = 0  # answers
        self.summary: dict[str, Any] | None = None
        self.not_finite = ""

    def begin(self, description: RobotDescription, *, lockstep: bool) -> None:
        """Record what everything after this belongs to."""
        now = self._clock.now()
        session = {
            "side": "controller",
            "session_id": self.claim.session_id,
            "lockstep": lockstep,
            "extra": self._controller.extra_names,
            "conditions": self._controller.conditions,
        }
        if self.steered:
            session["targets"] = [live.name for live in self._controller.live]
        self._recorder.record(Kind.DESCRIPTION, now, description.to_json())
        self._recorder.record(Kind.SESSION, now, json.dumps(session).encode())

    def note_config(self, config: bytes) -> None:
        """Record the configuration of the robot, JSON, as it came."""
        said = {"side": "robot", "config": config.decode("utf-8", "replace")}
        self._recorder.record(Kind.CONFIG, self._clock.now(), json.dumps(said).encode())

    def note_token(self, *, present: bool) -> None:
        """Record that the robot's liveliness token is seen, or has gone."""
        body = json.dumps({"who": "robot", "present": present}).encode()
        self._recorder.record(Kind.TOKEN, self._clock.now(), body)

    def note_request(self, request: Request, error: str | None) -> None:
        """Record what somebody asked of the controller, and whether it was refused, and why.

        Unless they ask too often; it is counted then.
        """
        now, limit = self._clock.now(), self._request_limit
        for verb, count in limit.left_out(now):
            fact = {"verb": verb, "left_out": count}
            self._recorder.record(Kind.REQUEST, now, json.dumps(fact).encode())
        if limit.passes(request.verb, now):
            fact = {"who": request.who, "verb": request.verb, "answer": {"error": error}}
            self._recorder.record(Kind.REQUEST, now, json.dumps(fact).encode())

    @property
    def epoch(self) -> int:
        """Authority under which it answers, 0 for none."""
        return self.claim.epoch

    @property
    def stale(self) -> bool:
        """Whether the robot was started anew, or follows us no longer, or its ticks went back."""
        return self.claim.stale

    def grant(self, epoch: int) -> None:
        """Answer under this authority from now on; 0 for none."""
        self.claim = replace(self.claim, epoch=epoch)
        body = json.dumps({"epoch": epoch}).encode()
        self._recorder.record(Kind.AUTHORITY, self._clock.now(), body)

    def answer(self, received: int, payload: bytes) -> bytes | None:
        """Answer a State that arrived at `received` [ns]; None where no answer is asked for.

        A controller without authority, or of a robot that is not active, follows in silence: it
        takes every step, so that it is warm, and sends nothing. It begins anew at each of the last
        ticks before its grant begins (`RUN_UP`). Call `sent` afterwards.

        Raises:
            Hoap3Error: the controller failed; names the tick, and the place in its code.
        """
        state, controller, now = self._state, self._controller, self._clock.now
        try:
            state.load(payload)
        except WireError:
            self.rejected += 1
            return None
        tick, session_id, epoch, claim = state.tick, state.session_id, state.epoch, self.claim
        if not claim.fits(session_id):
            self.foreign += 1
            self.claim = claim.update(session_id, state.mode, epoch, state.epoch_from_tick)
            return None
        if tick <= self._last_tick:
            self.repeated += 1
            self.claim = claim.doubt(tick < self._last_tick)
            return self._last_answer if tick == self._last_tick else None
        if self._lockstep:  # the robot's time is the time
            self._clock.sleep_until(state.stamp_published)
            received = now()
        decoded = now()
        if epoch != claim.epoch or claim.strange:
            self.claim = claim.update(session_id, state.mode, epoch, state.epoch_from_tick)
        if tick != self._last_tick + 1:
            self._note_gap(tick)
        self._last_tick = tick
        self._unrecorded.append((Kind.STATE, received, payload))
        asked = state.mode == State.ACTIVE and epoch == claim.epoch != 0
        try:
            if not self._started or asked != self._engaged:
                self.sum_up()
                last = self._reset(state)
                self._engaged = asked
                self._note_reset(tick, last)
            elif not asked and self._runs_up(state):
                self._reset(state)
            command = checked_step(controller, self._arrays, state, payload)
            command.stamp_solved = now()
            self.steps += 1
        except (Exception, SystemExit) as error:  # nobody else may end us
            self.announce("CONTROLLER_FAILED", tick)  # and the log has what it failed on
            raise failure(controller, f"failed at tick {tick}", error) from error
        if controller.present != self._present:
            self._note_conditions(controller.present)
        if not asked or (self.steered and self._falls_silent(tick)):
            self._last_answer = None
            return None
        command.session_id, command.tick, command.epoch = session_id, tick, epoch
        command.stamp_state, command.stamp_received = state.stamp_published, received
        command.stamp_decoded, command.stamp_sent_previous = decoded, self._sent_previous
        command.stamp_encoded = encoded = now()
        self._last_answer = answer = command.dump()
        self._unrecorded.append((Kind.SETPOINT, encoded, answer))
        self.answered += 1
        return answer

    def _falls_silent(self, tick: int) -> bool:
        """Whether nothing is to be sent, as a live target is stale that stops the robot."""
        silent = self.steering.silent(tick)
        if silent and not self._silent:
            self._note("TARGET_STALE", tick)
        self._silent = silent
        return silent

    def _runs_up(self, state: State) -> bool:
        """Whether the robot, at rest, follows us from one of the next ticks on."""
        ahead = state.epoch_from_tick - state.tick
        return state.mode == State.IDLE and self.epoch != 0 and 0 < ahead <= RUN_UP

    def sent(self) -> None:
        """The answer is on its way: now there is time to record what was done."""
        self._sent_previous = self._clock.now()
        if self.answered != self._noted:
            self._noted = self.answered
            command = self._controller.command
            self._outcome.note(self._state, command)
            if not (self.not_finite or all(map(isfinite, command.values.tolist()))):
                self._describe_not_finite(command)
        self._record()

    def _describe_not_finite(self, command: Setpoint) -> None:
        if command.solver_status == STATUS["infeasible"]:  # `refuse`: the controller means it
            return
        names, values = self._controller.description.joint_names, command.values.tolist()
        place = next(i for i, value in enumerate(values) if not isfinite(value))
        self.not_finite = (
            f"controller {type(self._controller).__name__}, tick {command.tick}: values[{place}] "
            f"({names[place]}) is {values[place]}, and the robot rejects such an answer like a "
            "missing one. Compute finite values; `hoap3 replay LOG --allow-code` repeats the tick"
        )

    def receive_event(self, payload: bytes) -> None:
        """Take an Event of the robot, and record that setpoints conflict, or that it stops.

        A stop that lasts until somebody recovers the robot is recorded in real time only: in
        virtual time nothing says between which States the word of it came, and a log would not be
        the same again.
        """
        event = self._robot_event
        try:
            event.load(payload)
        except WireError:  # any client may publish there
            self.rejected_events += 1
            return
        if event.session_id != self.claim.session_id:
            self.foreign_events += 1
            return
        now = self._clock.now()
        if event.kind == EVENTS["CONFLICTING_SETPOINTS"] and now >= self._conflict_due:
            self._conflict_due = now + HEARD_PAUSE_NS
            self.announce("CONFLICTING_SETPOINTS", event.detail)
        elif event.kind == EVENTS["SAFE_STOP"] and now >= self._stop_due:
            lasts = STOP_REASONS.get(event.detail) in LATCHING
            if lasts and not isinstance(self._clock, VirtualClock):
                self._stop_due = now + HEARD_PAUSE_NS
                self.announce("SAFE_STOP", event.detail)

    def sum_up(self) -> None:
        """Record what the answers so far came to, unless there is none since the last time.

        Called when the robot stops following, and at the end.

        Raises:
            Hoap3Error: the controller failed to tell the errors of its tasks.
        """
        if self._outcome.answers == self._summed_up:
            return
        self._summed_up = self._outcome.answers
        try:
            self.summary = self._outcome.as_json()
            if self.steered:
                self.summary["targets"] = self.steering.as_json()
            payload = json.dumps({"session_id": self.claim.session_id, **self.summary}).encode()
        except (Exception, SystemExit) as error:
            what = "failed to tell the errors of its tasks"
            raise failure(self._controller, what, error) from error
        self._recorder.record(Kind.SUMMARY, self._clock.now(), payload)

    def change(self, payload: bytes) -> None:
        """Have the controller take over a change, a JSON object, and record it.

        Raises:
            UsageError: it is none, the controller refuses it, or the robot does not follow: a
                controller begins anew when it does again. Nothing has changed.
            Hoap3Error: the controller failed.
        """
        if len(payload) > LONGEST_CHANGE:
            raise UsageError(f"the change has {len(payload)} bytes; at most {LONGEST_CHANGE}")
        try:
            request = json.loads(payload)
        except (ValueError, RecursionError) as error:  # the network may send anything
            raise UsageError(f"the change is not JSON ({error})") from error
        if not isinstance(request, dict):
            raise UsageError(f"the change is no JSON object, but {request!r:.60}")
        if not self._engaged:
            raise UsageError(
                "the robot does not follow the controller now, and changes would be reset when it "
                "does: run `hoap3 recover`, then send the change again"
            )
        try:
            self._controller.change(request)
        except (Exception, SystemExit) as error:
            raise failure(self._controller, "failed on a change", error) from error
        self._recorder.record(Kind.CHANGE, self._clock.now(), payload)
        self.announce("CHANGED", self.last_tick)

    def steer(self, who: str, payload: bytes) -> None:
        """Take a `Target` that somebody sent, and record it, or count why it is not taken."""
        if self.steering.take(who, payload, self.last_tick, following=self._engaged):
            self._recorder.record(Kind.TARGET, self._clock.now(), payload)

    def steer_again(self, payload: bytes) -> None:
        """Take a `Target` that was taken when it was recorded."""
        self.steering.follow(payload, self.last_tick)

    def operate(self, verb: str, who: str) -> dict[str, Any]:
        """Let somebody steer (`acquire`), or no longer (`release`); what it must know.

        Raises:
            UsageError: somebody else steers, or there is nothing to steer.
        """
        if verb == "release":
            return {"released": self.steering.release(who)}
        return self.steering.acquire(who, self.epoch, self.last_tick, following=self._engaged)

    def changeable(self) -> dict[str, Any]:
        """What can be changed, and what it is now.

        Raises:
            Hoap3Error: the controller failed.
        """
        try:
            present = self._controller.changeable()
            json.dumps(present)
        except (Exception, SystemExit) as error:
            raise failure(self._controller, "failed to say what can be changed", error) from error
        return present

    def about(self, config: bytes = b"") -> bytes:
        """The answer to those who ask what it is: names, live targets, what can be changed.

        It stays, so it is made once, before the controller answers any State.

        Args:
            config: of the controller, JSON; empty where it is too long to be told.

        Raises:
            Hoap3Error: the controller failed, or says what is no JSON.
        """
        controller = self._controller
        try:
            now = {
                "extra": list(controller.extra_names),
                "conditions": list(controller.conditions),
                "margin_tolerance": controller.margin_tolerance,
                "targets": [live.as_json() for live in controller.live],
                "numbers": controller.numbers(),
                "config": json.loads(config) if config else None,
            }
            return json.dumps({"error": None, "now": now}).encode()
        except (Exception, SystemExit) as error:
            raise failure(controller, "failed to say what it is", error) from error

    def ignored(self) -> str:
        """Return how many messages had no effect, by reason; "" where there were none."""
        counts = {
            "repeated States": self.repeated,
            "malformed States": self.rejected,
            "States of other sessions": self.foreign,
            "malformed Events": self.rejected_events,
            "Events of other sessions": self.foreign_events,
        }
        return ", ".join(f"{count} {what}" for what, count in counts.items() if count)

    def outcome(self) -> dict[str, Any]:
        """What the answers came to so far, and how the tasks stand.

        Raises:
            Hoap3Error: the controller failed.
        """
        try:
            return self._outcome.as_json()
        except (Exception, SystemExit) as error:
            raise failure(self._controller, "failed to say how its tasks stand", error) from error

    @property
    def last_tick(self) -> int:
        """The newest tick seen, or 0."""
        return max(self._last_tick, 0)

    def announce(self, kind: str, detail: int) -> None:
        """Record an event."""
        self._note(kind, detail)
        self._record()

    def _record(self) -> None:
        record = self._recorder.record
        for kind, stamp, payload in self._unrecorded:
            record(kind, stamp, payload)
        self._unrecorded.clear()

    def _note(self, kind: str, detail: int) -> None:
        event = self._event
        event.kind, event.tick, event.detail = EVENTS[kind], self.last_tick, detail
        event.stamp = self._clock.now()
        self._unrecorded.append((Kind.EVENT, event.stamp, event.dump()))

    def _note_reset(self, tick: int, last: FloatArray | None) -> None:
        """Record from what the controller begins anew: all that it remembers."""
        self._note("RESET", tick)
        command = None if last is None else [x if isfinite(x) else None for x in last.tolist()]
        memory = json.dumps({"tick": tick, "last_command": command}).encode()
        self._unrecorded.append((Kind.RESET, self._event.stamp, memory))

    def _note_conditions(self, present: int) -> None:
        for number in range(len(self._controller.conditions)):
            now, before = present >> number & 1, self._present >> number & 1
            if now != before:
                self._note("CONDITION_BEGAN" if now else "CONDITION_ENDED", number)
        self._present = present

    def _note_gap(self, tick: int) -> None:
        """Count the States between the last one seen and this one; before the first are none."""
        if self._last_tick >= 0:
            missed = tick - self._last_tick - 1
            self.overwritten += missed
            self._note("OVERWRITTEN", missed)

    def _reset(self, state: State) -> FloatArray | None:
        """Have the controller begin anew; what it last sent, or None."""
        command = self._controller.command
        last: FloatArray | None = command.values.copy() if self._last_answer else None
        self._controller.forget_changes()
        self._controller.reset(state, last)
        self._started = True
        return last
