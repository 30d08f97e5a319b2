"""The robot's tick: take the newest setpoint, move, measure, publish.

Everything happens in one thread and in one order, on whatever clock and link it is given, so the
same code runs against the wall clock, in lockstep, and under the tests' virtual time.

In real time a tick's State should leave at once. Where the answer to the last one is here, or none
was asked for, nothing that comes later can change what the robot does next: so it is done ahead of
the tick, and when that begins only the State is left to be sent.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Mapping
from itertools import islice

import numpy as np

from hoap3.protocol.link.base import Request, RobotLink
from hoap3.protocol.link.session_limits import MAX_CONFIG_BYTES
from hoap3.protocol.messages import COMMANDS, Event, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.clock import Clock, VirtualClock
from hoap3.protocol.runtime.deadlines import Durations
from hoap3.protocol.runtime.event_limit import EventLimit
from hoap3.protocol.runtime.realtime import Ticker
from hoap3.protocol.runtime.recorder import Recorder
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.protocol.stop_reasons import STOP_REASONS
from hoap3.robot_emulator.authority import ENDING, NAME_TAKEN, NO_TOKEN, Authority
from hoap3.robot_emulator.body_watch import BodyWatch
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.filters.base import STARTUP_TICKS, SetpointFilter, limit_figures
from hoap3.robot_emulator.plant_factory import build_body
from hoap3.robot_emulator.plants.base import TOLD
from hoap3.robot_emulator.setpoint_validator import (
    MAX_LENGTHS,
    REJECTION_KINDS,
    SetpointValidator,
)

VERBS = ("description", "config", "status", "acquire", "release", "gone", "stop", "recover")
OTHER, TOKEN, CONFIG = "other", "token", "configuration"
"""What else is limited: requests of no such verb, clients' tokens, and their configurations."""

GRACE_TICKS = 20
"""Ticks between a grant and the first answer that is asked for, in real time."""

CONFLICT_PAUSE_NS = 1_000_000_000  # between two events that tell of conflicting setpoints
REQUESTS_PER_TICK = 4  # in real time; the rest waits for the next tick

EVENTS = Event.schema.constants
_COUNTED = ("asked", "in_time", "run_rate", "longest_run", "worst_window")
LIMIT_SHIFT = 16  # bits of a joint in the detail of CLIPPED
_FAILURES = {EVENTS["REASON_MISSES"], EVENTS["REASON_HOLDER_LOST"]}


class RobotLoop:
    """One robot.

    Args:
        description: of the robot.
        config: of the emulator; with the description it decides about its body.
        clock, link, recorder: what it runs on.
        session_id: new at each start.
        grace_ticks: between a grant and the first answer that is asked for.
        lead: how long before a tick it may act [ns]; 0: never.

    Attributes:
        plant: the body.
        safe_stops: how often misses or a lost holder forced a safe stop.
        skipped: ticks skipped since the start.
        validator: counts of setpoints and deadlines.
        realtime: what the operating system gave, in words.
    """

    def __init__(
        self,
        description: RobotDescription,
        config: EmulatorConfig,
        clock: Clock,
        link: RobotLink,
        recorder: Recorder,
        session_id: int,
        grace_ticks: int = GRACE_TICKS,
        lead: int = 0,
    ) -> None:
        self._description, self._config = description, config
        self._description_json = description.to_json()
        self._config_json = config.model_dump_json().encode()
        lockstep = isinstance(clock, VirtualClock)
        self._requests_per_tick = None if lockstep else REQUESTS_PER_TICK
        self._clock, self._link, self._recorder = clock, link, recorder
        self.period = round(description.period_s * 1e9)
        posture = config.posture
        if not isinstance(posture, str):
            posture = description.initial_posture
        start = np.array(description.postures[posture])
        self.plant, self._setpoint_filter = build_body(description, config)
        self.plant.reset(start)
        self._setpoint_filter.reset(self.plant.start)
        self._plant_times = None if lockstep else Durations()
        self._authority = Authority()
        self._lease_ticks = round(config.link.lease_ms * 1e6 / self.period)
        self._grace_ticks, self._lead = grace_ticks, lead
        self._acted = False  # for the next tick
        self._stop_began = 0
        self._first_active_tick = -1
        self._pending = deque[tuple[int, int]]()  # ticks that asked, and at which each is judged
        self._delay, self._due = description.delay_ticks, description.due
        self._from_publication = description.deadline == "after_receipt"
        self._terms = {
            "deadline": description.deadline,
            "delay_ticks": self._delay,
            "setpoint_arrays": MAX_LENGTHS,
        }
        self._clipped = self._log_lost = False
        self._held = [0] * description.n  # periods, by the first joint held back in each
        self._held_first = (-1, -1)  # joint, tick
        self._first_limit: dict[str, object] | None = None  # that clipped it
        self._active_from = self._startup_held = 0  # tick; periods of `STARTUP_TICKS` from there
        self._conflicts_told = self._conflict_due = self._name_conflicts = 0
        self._overloaded = -1
        self.safe_stops = self.skipped = self._skipped_active = 0
        self.validator = SetpointValidator(
            description.n,
            session_id,
            COMMANDS[description.command_kinds[0]],
            delayed=self._delay > 0,
        )
        self._state = State.allocate(**description.state_lengths)
        self._state.session_id = session_id
        self._event = Event()
        self._event.session_id = session_id
        self._event_limit = EventLimit()
        self._request_limit = EventLimit((*VERBS, OTHER, TOKEN, CONFIG))
        self._tells_motion = bool(description.state_arrays)
        plant = self.plant
        self._measured = [  # what State has of it, and where it has it
            (getattr(self._state, name), getattr(plant, name))
            for name in ("q", "dq", "tau", "wrench", *TOLD)
        ]
        self._body = BodyWatch(description, plant.q, plant.base)
        self._followed = -1  # tick of the setpoint in use
        self._earlier_rate = np.zeros(description.n)
        self.tick = self._published = -1
        self._unrecorded = b""  # State
        self.realtime: list[str] = []

    def run(self, start: int, should_stop: Callable[[], bool], ticks: int | None = None) -> None:
        """Tick from `start` [ns]; come to rest when told to stop, or `ticks` after it was active.

        Args:
            start: begin of tick 0 on the clock [ns].
            should_stop: asked at each tick.
            ticks: duration, counted from the first active tick, or None for no end.
        """

        def stop_if_due(tick: int) -> None:
            if should_stop():
                self.stop("REASON_SHUTDOWN")
            elif ticks is not None and 0 <= self._first_active_tick <= tick - ticks:
                self.stop("REASON_ENDED")

        ticker = Ticker(self._clock, self.period, start)
        self._announce("STARTED", 0)
        while True:
            if self._may_act_ahead(ticker):
                stop_if_due(ticker.tick + 1)
                self._act(ticker.tick + 1)
                self._acted = True
                ticker.wait()
            else:
                ticker.wait()
                stop_if_due(ticker.tick)
            self.step(ticker)
            at_rest = self._authority.mode == State.STOPPED and not self._pending
            if at_rest and self._authority.stop_reason in ENDING:
                break
        self._record_state()
        self._tell_left_out(at_end=True)
        self._announce("ENDED", 0)
        summary = json.dumps(self.summary()).encode()
        self._recorder.record(Kind.SUMMARY, self._clock.now(), summary)

    def summary(self) -> dict[str, object]:
        """What the robot counted; docs/start/concepts.md defines each figure."""
        return {
            **self._counts(),
            "conflicting": self.validator.conflicting,
            "rejections": {name: n for name, n in self.validator.rejections.items() if n},
            "realtime": self.realtime,
            "link_counts": self._link.counts(),
            **({"plant": figures} if (figures := self.plant.summary()) else {}),
            **({"plant_us": self._plant_times.summary()} if self._plant_times else {}),
        }

    def _counts(self) -> dict[str, object]:
        """What verdicts on deadlines and limits rest on, so far."""
        deadlines = self.validator.deadlines
        return {
            **{name: getattr(deadlines, name) for name in _COUNTED},
            "skipped": self._skipped_active,
            "safe_stops": self.safe_stops,
            "misses_to_stop": self._config.misses_to_stop,
            "interventions": self._setpoint_filter.interventions,
            "startup_interventions": self._startup_held,
            "held_back_joints": self._held_back_joints(),
            "held_back_limit": self._first_limit,
            **self._body.summary(),
            "torque_limited": self._setpoint_filter.torque_limited + self.plant.saturated,
        }

    @property
    def mode(self) -> int:
        """State.IDLE, ACTIVE, STOPPING or STOPPED."""
        return self._authority.mode

    @property
    def setpoint_filter(self) -> SetpointFilter:
        """What stands between setpoints and the body; for those who look on."""
        return self._setpoint_filter

    def _held_back_joints(self) -> dict[str, object] | None:
        """Which joint was held back first, and which in most periods; None where none was."""
        names, (joint, tick) = self._description.joint_names, self._held_first
        if joint < 0:
            return None
        periods = max(self._held)
        most = names[self._held.index(periods)]
        return {"first": names[joint], "first_tick": tick, "most": most, "most_periods": periods}

    def step(self, ticker: Ticker) -> None:
        """Everything that happens at one tick, or what is left of it."""
        if self._acted:
            self._receive(self._published)  # what still came
        if ticker.skipped:
            self.tick = ticker.tick
            self.skipped += ticker.skipped
            self._announce("SKIPPED", ticker.skipped)
            if self._acted:
                self._judge()  # deadlines that came with the ticks skipped
        if not self._acted:
            self._act(ticker.tick)
        self._acted = False
        if ticker.skipped and self._state.mode == self._authority.mode == State.ACTIVE:
            self._skipped_active += ticker.skipped
        self.tick = self._published = ticker.tick
        self._publish(ticker)
        if self._authority.mode == State.ACTIVE:
            self._ask(ticker)

    def _may_act_ahead(self, ticker: Ticker) -> bool:
        """Whether the next tick is still to come, and all is known that it depends on."""
        if not self._lead:
            return False
        self._clock.sleep_until(ticker.next - self._lead)
        self._record_state()
        self._receive(self._published)
        return self._knows(ticker.tick + 1) and self._clock.now() < ticker.next

    def _knows(self, tick: int) -> bool:
        """Whether no answer that is still to come can change what the robot does at a tick."""
        newest = tick - 1 - self._delay  # the answer to it is applied then
        for asked, judged in self._pending:
            if (judged <= tick or asked <= newest) and not self.validator.in_time(asked):
                return False
        return (
            not self._delay
            or self._authority.mode != State.ACTIVE
            or self.validator.settled(newest)
        )

    def _ask(self, ticker: Ticker) -> None:
        """Note until when the State just published can be answered, and when that is judged."""
        tick, begin = ticker.tick, ticker.intended
        judged = tick + 1 + self._delay
        if self._from_publication:
            late = self._state.stamp_published - begin
            begin += late
            judged += -(-late // self.period)
        self._pending.append((tick, judged))
        self.validator.ask(tick, self._authority.followed, begin + self._due)

    def _act(self, tick: int) -> None:
        """What the robot does for a tick before it measures."""
        self.tick = tick
        for request in islice(self._link.requests(), self._requests_per_tick):
            self._serve(request)
        self._look_after_holder()
        if self._link.name_conflicts != self._name_conflicts:
            self._name_conflicts = self._link.name_conflicts
            self._announce("NAME_CONFLICT", self._name_conflicts)
        for who, present in self._link.tokens():
            self._record_fact(Kind.TOKEN, TOKEN, {"who": who, "present": present})
        if self._event_limit.any_left_out or self._request_limit.any_left_out:
            self._tell_left_out()
        if self._recorder.lost is not None and not self._log_lost:
            self._log_lost = True
            self._announce("LOG_LOST", self._recorder.lost)
        self._receive(self._published)
        self._judge()
        self._obey_grant()
        self._move()
        self._advance()

    def stop(self, reason: str) -> None:
        """Brake to rest; a stop that lasts until a recovery is not weakened by a later release."""
        self._enter(self._authority.stop(EVENTS[reason]))

    def _enter(self, authority: Authority) -> None:
        """Stand so from now on; where the robot was active and is no longer, begin to brake."""
        before, self._authority = self._authority, authority
        if before.mode == State.ACTIVE != authority.mode:
            self._setpoint_filter.begin_stop()
            self._stop_began = self.tick
            self.safe_stops += authority.stop_reason in _FAILURES
            self._announce("SAFE_STOP", authority.stop_reason)

    def _receive(self, published: int) -> None:
        """Accept or refuse the setpoints that have arrived since the last tick."""
        for stamp, payload in self._link.drain():
            self._recorder.record(Kind.SETPOINT, stamp, payload)
            reason = self.validator.accept(stamp, payload, published)
            if reason is not None:
                place = REJECTION_KINDS.index(reason)
                self._recorder.reject(place)
                if self.validator.rejections[reason] == 1:
                    self._announce("REJECTED", place)
        if self.validator.conflicting != self._conflicts_told:
            self._tell_conflicts()

    def _tell_conflicts(self) -> None:
        """Announce that another client sends setpoints, too: at once, then once a second."""
        now = self._clock.now()
        if now >= self._conflict_due:
            self._conflict_due = now + CONFLICT_PAUSE_NS
            self._conflicts_told = self.validator.conflicting
            self._announce("CONFLICTING_SETPOINTS", self._conflicts_told)

    def _judge(self) -> None:
        """Count the outcomes of ticks whose deadline has come, and stop after too many misses."""
        pending, validator = self._pending, self.validator
        while pending and pending[0][1] <= self.tick:
            in_time = validator.count(pending.popleft()[0])
            if self._authority.mode != State.ACTIVE:
                continue  # it was told to stop before
            if not in_time and validator.deadlines.misses_in_a_row >= self._config.misses_to_stop:
                self.stop("REASON_MISSES")

    def _obey_grant(self) -> None:
        """From its first tick on, a grant makes the robot active."""
        before = self._authority
        self._authority = before.begin(self.tick)
        if self._authority is not before:
            self._setpoint_filter.forget()
            self._followed = -1
            self._active_from = self.tick
            self.validator.start_anew(self.tick)
            if self._first_active_tick < 0:
                self._first_active_tick = self.tick

    def _move(self) -> None:
        """Decide what drives the body for one period."""
        setpoint_filter, validator = self._setpoint_filter, self.validator
        if self._authority.mode == State.ACTIVE:
            if self._delay:
                validator.release(self.tick - 1 - self._delay)
            if validator.fresh:
                validator.fresh = False
                self._followed = validator.setpoint.tick
                clipped = setpoint_filter.follow(validator.setpoint.values, validator.setpoint.tick)
            elif self._config.loss_policy == "extrapolate":
                clipped = setpoint_filter.extrapolate()
            else:
                clipped = setpoint_filter.hold()
            if clipped >= 0 and not self._clipped:
                limit = setpoint_filter.limit_of(clipped)
                self._announce("CLIPPED", clipped + (limit << LIMIT_SHIFT))
            self._clipped = clipped >= 0
        elif self._authority.mode == State.STOPPING:
            if setpoint_filter.brake():
                self._announce("AT_REST", self.tick - self._stop_began)
                self._authority = self._authority.come_to_rest()
        else:
            return
        joint = setpoint_filter.held_back
        if joint >= 0:  # count the period by it
            self._held[joint] += 1
            self._startup_held += self.tick < self._active_from + STARTUP_TICKS
            if self._held_first[0] < 0:
                self._held_first = joint, self.tick
                limit, at = setpoint_filter.limit_of(joint), float(setpoint_filter.reference[joint])
                self._first_limit = limit_figures(self._description, joint, limit, at)

    def _advance(self) -> None:
        """The body moves for one period; at rest its brakes hold it."""
        moving = self._authority.mode in (State.ACTIVE, State.STOPPING)
        overloaded = self._setpoint_filter.overloaded if moving else -1
        if overloaded >= 0 > self._overloaded:
            self._announce("TORQUE_LIMITED", overloaded)
        self._overloaded = overloaded
        times = self._plant_times if self._authority.mode == State.ACTIVE else None
        began = self._clock.now() if times else 0
        if moving:
            self.plant.step(self._setpoint_filter.value, self._description.period_s)
        else:
            self.plant.hold(self._description.period_s)
        if times:
            times.add(self._clock.now() - began, self.tick)

    def _publish(self, ticker: Ticker) -> None:
        state, validator, authority = self._state, self.validator, self._authority
        state.tick, state.mode, state.epoch = ticker.tick, authority.mode, authority.followed
        state.epoch_from_tick = authority.told_from_tick
        state.stamp_intended, state.stamp_actual = ticker.intended, ticker.actual
        deadlines = validator.deadlines
        state.skipped, state.late, state.lost = self.skipped, deadlines.late, deadlines.lost
        state.duplicate, state.out_of_order = validator.duplicate, validator.out_of_order
        state.rejected, state.success_rate = validator.rejected, deadlines.success_rate
        for told, measured in self._measured:
            told[:] = measured
        self._body.look(ticker.tick)
        state.reference[:] = self._setpoint_filter.reference
        if self._tells_motion:
            self._tell_motion()
        state.stamp_published = self._clock.now()
        payload = state.dump()
        self._link.publish(payload)
        state.stamp_sent_previous = self._clock.now()
        self._unrecorded = payload
        if not self._lead:
            self._record_state()

    def _tell_motion(self) -> None:
        """How the reference moved in the last period, and which setpoint it follows."""
        state, earlier = self._state, self._earlier_rate
        state.reference_rate[:] = rate = self._setpoint_filter.rate
        np.subtract(rate, earlier, out=state.reference_acceleration)
        state.reference_acceleration /= self._description.period_s
        earlier[:] = rate
        state.followed[0] = self._followed if self._authority.mode == State.ACTIVE else -1.0

    def _record_state(self) -> None:
        """Record the newest State: in real time after a sleep, in which the answer is made."""
        if self._unrecorded:
            self._recorder.record(Kind.STATE, self._state.stamp_published, self._unrecorded)
            self._unrecorded = b""

    def _serve(self, request: Request) -> None:
        """Answer a request, and record it; docs/reference/wire.md has the answers."""
        answer = self._answer(request)
        request.answer(answer)
        verb = request.verb if request.verb in VERBS else OTHER
        known = {"bytes": len(answer)} if isinstance(answer, bytes) else answer
        asked = {"who": request.who, "verb": request.verb, "answer": known}
        self._record_fact(Kind.REQUEST, verb, asked)

    def _answer(self, request: Request) -> dict[str, object] | bytes:
        match request.verb:
            case "description":
                return self._description_json
            case "config":
                return self._config_json
            case "acquire":
                return self._grant(request)
            case "release":
                grant = self._authority.grant  # its own machine's user may take it from anybody
                who = grant.holder if request.local and grant is not None else request.who
                return {"released": self._release(who, "RELEASED")}
            case "gone":
                return {"released": self._release(request.who, "HOLDER_LOST")}
            case "stop":
                self.stop("REASON_COMMAND")
                return self._status()
            case "recover":
                return {"recovered": self._recover(), **self._status()}
            case "status":
                return {**self._status(), "counts": self._counts()}
            case other:
                return {"error": f"unknown request {other!r}"}

    def _record_fact(self, kind: Kind, limited: str, fact: Mapping[str, object]) -> None:
        """Record what others did, unless they do it too often; it is counted then."""
        now = self._clock.now()
        if self._request_limit.passes(limited, now):
            self._recorder.record(kind, now, json.dumps(fact).encode())

    def _status(self) -> dict[str, object]:
        grant = self._authority.grant
        return {
            "mode": ("idle", "active", "stopping", "stopped")[self.mode],
            "holder": grant.holder if grant else None,
            "session_id": self._state.session_id,
            "tick": self.tick,
            "lockstep": isinstance(self._clock, VirtualClock),
            "stop_reason": STOP_REASONS.get(self._authority.stop_reason),
            "name_conflicts": self._link.name_conflicts,
        }

    def _grant(self, request: Request) -> dict[str, object]:
        before = self._authority
        self._authority, refusal = before.acquire(
            request.who,
            present=request.present,
            tick=self.tick,
            from_tick=self._first_tick(),
            lease=self._lease_ticks,
            unique=not self._link.name_conflicts,
        )
        grant = self._authority.grant
        if refusal == NO_TOKEN:
            self._link.look_again(request.who)
            return self._refusal(refusal, 0)
        if refusal == NAME_TAKEN:
            return self._refusal(refusal, -1)
        if refusal or grant is None:
            return self._refusal(refusal, grant.epoch if grant else 0)
        if before.grant is None:
            self._announce("GRANTED", grant.epoch)
            self._record_config(request)
        terms = {"granted": True, "epoch": grant.epoch, "from_tick": grant.from_tick}
        return {**terms, **self._terms, **self._status()}

    def _record_config(self, request: Request) -> None:
        """Record the configuration that a controller sent with its request, as it came."""
        if request.body and len(request.body) <= MAX_CONFIG_BYTES:
            config = request.body.decode("utf-8", "replace")
            said = {"side": "controller", "who": request.who, "config": config}
            self._record_fact(Kind.CONFIG, CONFIG, said)

    def _first_tick(self) -> int:
        """Of a grant from now on: after all deadlines of an earlier one."""
        first = self.tick + self._grace_ticks
        return max(first, self._pending[-1][1]) if self._pending else first

    def _refusal(self, reason: str, epoch: int) -> dict[str, object]:
        self._announce("REFUSED", epoch)
        return {"granted": False, "reason": reason, **self._status()}

    def _look_after_holder(self) -> None:
        """Have the holder looked up once each lease, and after a refusal or a recovery."""
        holder = self._authority.to_look_up(self.tick)
        if holder is not None:
            self._authority = self._authority.looked_up(self.tick, self._lease_ticks)
            self._link.look_again(holder)

    def _release(self, who: str, event: str) -> bool:
        before = self._authority.grant
        reason = "REASON_RELEASED" if event == "RELEASED" else "REASON_HOLDER_LOST"
        after = self._authority.drop(who, EVENTS[reason])
        if before is None or after.grant is not None:
            return False
        self._announce(event, before.epoch)
        self._enter(after)
        return True

    def _recover(self) -> bool:
        """Release the latch; the holder, if there is one, goes on after the grace period."""
        stopped = self.mode == State.STOPPED
        self._authority = self._authority.recover(self.tick, self._first_tick())
        if stopped:
            self._announce("RECOVERED", 0)
        return stopped

    def _tell_left_out(self, *, at_end: bool = False) -> None:
        """Tell how many events and requests were left out, at most once a second for each kind."""
        now = self._clock.now()
        for kind, count in self._event_limit.left_out(now, at_end=at_end):
            self._announce("SUPPRESSED", count << 8 | EVENTS[kind])
        for verb, count in self._request_limit.left_out(now, at_end=at_end):
            fact = json.dumps({"verb": verb, "left_out": count}).encode()
            self._recorder.record(Kind.REQUEST, now, fact)

    def _announce(self, kind: str, detail: int) -> None:
        if not self._event_limit.passes(kind, self._clock.now()):
            return
        event = self._event
        event.kind, event.tick, event.detail = EVENTS[kind], max(self.tick, 0), detail
        event.stamp = self._clock.now()
        payload = event.dump()
        self._link.announce(payload)
        self._recorder.record(Kind.EVENT, event.stamp, payload)
