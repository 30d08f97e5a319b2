"""The table of ticks of a run, from its logs: outcomes, stages, and the stage of each miss.

The time from the intended start of a tick to the arrival of its answer is cut into stages:

    wakeup · publish · wait · decode · kinematics · solve · encode · send · network

`wakeup` and `publish` are the robot's: until it woke, and until it had published its State.
`wait` is how long the State waited for the controller to end an earlier cycle. The next five are
the controller's. `network` is what remains of the RTT, both ways together: sockets, link threads,
and all the time in which the controller could run but did not. Terms: docs/start/concepts.md.

A miss goes to the stage that exceeded its usual length by most. Where that is `wait`, it goes to
the stage that held up the cycle for which it waited: one slow solve may cost several ticks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hoap3.protocol.errors import LogError
from hoap3.protocol.messages import COMMANDS, FloatArray, Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.analysis.cycles import EVENTS, NEVER, Cycles, Flags, Stamps
from hoap3.tools.analysis.miss_attribution import Times, attribute_misses, between, cycle_stages
from hoap3.tools.logs.disk_rows import RowsAt
from hoap3.tools.logs.log import Log, Rows
from hoap3.tools.machine.stalls import GRID_NS, Stall

IN_TIME, LATE, LOST, SKIPPED = range(4)
OUTCOMES = ("in time", "late", "lost", "skipped")
STAGES = (
    "wakeup", "publish", "wait", "decode", "kinematics", "solve", "encode", "send", "network",
)  # fmt: skip
"""In the order of time. RTT is the sum of all from `wait` on, where nothing is unaccounted."""

_COUNTED = ("rejected", "duplicate", "out_of_order")
_FAILURES = (EVENTS["REASON_MISSES"], EVENTS["REASON_HOLDER_LOST"])
_ROWS = ("tick", "intended", "actual", "published", "arrival", "refused", "outcome", "end")


@dataclass(frozen=True, repr=False)
class TickTable:
    """One entry for each tick that asked for an answer, and for each that was skipped meanwhile.

    Stamps [ns] are the robot's; `NEVER` where there is none. Of a log that ends in
    motion, ticks whose deadline is not past are left out, unless their answer is there: nobody
    knows what became of them.

    Attributes:
        period: T [ns].
        due: how long an answer has [ns].
        from_publication: it has it from the publication of its State, not from the intended start.
        tick: its number, ascending.
        intended: start on the schedule.
        actual, published: wake-up, and publication of the State; NEVER for skipped ticks.
        arrival: of the first valid answer; NEVER where none came.
        refused: a setpoint came that names this tick, and the robot did not take it.
        outcome: IN_TIME, LATE, LOST or SKIPPED.
        end: until when, from the intended start, a stall of the host makes a miss the host's: the
            deadline; for the last of several that were skipped, until the robot woke.
        cycles: of the controller.
        cycle: place of the tick in `cycles`, -1 where the controller had none that we know of.
        stalls: of the host, of all CPUs, by their begin; None where nobody watched.
        lockstep: all stamps are virtual, so durations say nothing of this machine.
        messages: how many setpoints were `rejected`, `duplicate`, `out_of_order`.
        safe_stops: how often misses, or a holder that vanished, made the robot stop.
        misses_to_stop: misses in a row that stop it; None where that is not known.
    """

    period: int
    due: int
    from_publication: bool
    tick: Stamps
    intended: Stamps
    actual: Stamps
    published: Stamps
    arrival: Stamps
    refused: Flags
    outcome: npt.NDArray[np.int64]
    end: Stamps
    cycles: Cycles
    cycle: Stamps
    stalls: list[Stall] | None
    lockstep: bool
    messages: dict[str, int]
    safe_stops: int
    left_out: dict[str, int]
    misses_to_stop: int | None = None

    @classmethod
    def from_run(cls, folder: Path | str) -> TickTable:
        """Read the logs in the folder of a run, or the log of a robot alone.

        Raises:
            LogError: the robot's log is missing, or a log cannot be read.
        """
        path = Path(folder)
        both = path.is_dir() and any(path.glob("controller*.mcap"))
        controller = Log.open(path, side="controller") if both else None
        return cls.from_logs(Log.open(path, side="robot"), controller)

    @classmethod
    def from_logs(cls, log: Log, controller: Log | None) -> TickTable:
        """Read the open log of a robot, and that of its controller where there is one.

        Raises:
            LogError: it cannot be read, holds no State, or was recorded from outside: then the
                arrival stamps are not the robot's.
        """
        if "recorded" in log.metadata.get("run", {}):
            raise LogError(
                f"{log.paths[0]}: was recorded from outside, so it is not known when setpoints "
                "reached the robot. Name the log that the robot itself has written"
            )
        description = log.description
        (arrivals, setpoints), (_, events) = log.table(Kind.SETPOINT), log.table(Kind.EVENT)
        every = log.states()
        if not len(every):
            raise LogError(f"{log.paths[0]}: holds no State. Name the log of a run")
        session = int(every["session_id"][-1])
        states = RowsAt.of(every)[every["session_id"] == session]
        left_out = {"States of other sessions": len(every) - len(states)}
        for kind, unreadable in log.unreadable.items():
            left_out[f"messages of kind {kind.name} that cannot be read"] = unreadable
        states = states[np.argsort(states["tick"], kind="stable")]
        period, due = round(description.period_s * 1e9), description.due
        from_publication = description.deadline == "after_receipt"
        valid = _valid_answers(states, setpoints, arrivals, description)
        cycles = Cycles.read(controller, session, RowsAt.of(setpoints)[valid])
        active = states["mode"] == State.ACTIVE
        number = states["tick"].astype(np.int64)
        asked = states[active]
        ticks = number[active]
        arrival, refused = _arrivals(ticks, setpoints["tick"], arrivals, valid)
        intended, published = asked["stamp_intended"], asked["stamp_published"]
        deadline = (published if from_publication else intended) + due
        outcome = np.where(arrival <= deadline, IN_TIME, LATE)
        outcome[arrival == NEVER] = LOST
        known = (deadline <= states["stamp_intended"][-1]) | (outcome == IN_TIME)
        rows = {
            "tick": ticks,
            "intended": intended,
            "actual": asked["stamp_actual"],
            "published": published,
            "arrival": arrival,
            "refused": refused,
            "outcome": outcome,
            "end": deadline,
        }
        skipped, at, back = _skipped(number, states["skipped"], active)
        none = np.full(len(skipped), NEVER)
        more = {
            "tick": skipped,
            "intended": states["stamp_intended"][at] - back * period,
            "actual": none,
            "published": none,
            "arrival": none,
            "refused": np.zeros(len(skipped), bool),
            "outcome": np.full(len(skipped), SKIPPED),
            "end": np.where(
                back > 1,
                states["stamp_intended"][at] - (back - 1) * period,
                states["stamp_actual"][at],
            ),
        }
        whole = {name: np.concatenate([rows[name][known], more[name]]) for name in rows}
        order = np.argsort(whole["tick"], kind="stable")
        whole = {name: values[order] for name, values in whole.items()}
        stops = events["kind"] == EVENTS["SAFE_STOP"]
        misses_to_stop = (log.settings or {}).get("misses_to_stop")
        return cls(
            period=period,
            due=due,
            from_publication=from_publication,
            **whole,
            cycles=cycles,
            cycle=_places(cycles.tick, whole["tick"]),
            stalls=_stalls(events),
            lockstep=bool(log.session.get("lockstep")),
            messages={name: int(states[-1][name] - states[0][name]) for name in _COUNTED},
            safe_stops=int(np.count_nonzero(stops & np.isin(events["detail"], _FAILURES))),
            misses_to_stop=misses_to_stop if isinstance(misses_to_stop, int) else None,
            left_out={what: count for what, count in left_out.items() if count},
        )

    def after(self, warm_up: int) -> TickTable:
        """Without the first so many ticks; stalls that were over before are left out.

        Messages cannot be told apart by tick, and are counted from the begin all the same.
        """
        left = {name: getattr(self, name)[warm_up:] for name in (*_ROWS, "cycle")}
        stalls = self.stalls
        if stalls is not None and len(left["tick"]):
            stalls = [stall for stall in stalls if stall.end > left["intended"][0]]
        return replace(self, **left, stalls=stalls)

    def __len__(self) -> int:
        return len(self.tick)

    def __repr__(self) -> str:
        counts = ", ".join(f"{self.count(place)} {name}" for place, name in enumerate(OUTCOMES))
        return f"TickTable({counts})"

    def count(self, outcome: int) -> int:
        """How many ticks had this outcome."""
        return int(np.count_nonzero(self.outcome == outcome))

    @cached_property
    def asked(self) -> Flags:
        """Which ticks asked for an answer: all but the skipped ones."""
        asked: Flags = self.outcome != SKIPPED
        return asked

    @cached_property
    def missed(self) -> Flags:
        """Which ticks are late, lost or skipped."""
        missed: Flags = self.outcome != IN_TIME
        return missed

    @property
    def start_ns(self) -> int:
        """Intended start of the first tick."""
        return int(self.intended[0])

    @property
    def seconds(self) -> FloatArray:
        """Intended start of each tick, from the first one on [s]."""
        return np.asarray((self.intended - self.start_ns) / 1e9, float)

    @property
    def duration_s(self) -> float:
        """From the first tick to the end of the last one."""
        return float(self.seconds[-1]) + self.period / 1e9

    @property
    def rule(self) -> dict[str, Any]:
        """What is late, as the robot's description says: `deadline` and `delay_ticks`."""
        deadline = "after_receipt" if self.from_publication else "next_tick"
        return {"deadline": deadline, "delay_ticks": self.due // self.period - 1}

    @cached_property
    def stalled(self) -> Flags | None:
        """Which ticks overlap a stall of the host between `intended` and `end`.

        A stall counts from one period of the monitor's grid before it was seen.
        """
        if self.stalls is None:
            return None
        starts = np.array([stall.start for stall in self.stalls], np.int64) - GRID_NS
        ends = np.array([NEVER, *(stall.end for stall in self.stalls)], np.int64)
        last_end = np.maximum.accumulate(ends)  # CPUs stall independently
        stalled: Flags = last_end[np.searchsorted(starts, self.end, "left")] > self.intended
        return stalled

    @property
    def stalls_of_motion(self) -> list[Stall] | None:
        """Stalls from the first tick that asked to the end of the last; None if unwatched."""
        if self.stalls is None or not len(self):
            return self.stalls
        begin, end = int(self.intended[0]), int(self.end.max())
        return [stall for stall in self.stalls if stall.end > begin and stall.start < end]

    @property
    def success_rate(self) -> float | None:
        """Share of answers in time among the ticks that asked; None if none did."""
        asked = int(np.count_nonzero(self.asked))
        return self.count(IN_TIME) / asked if asked else None

    @property
    def misses_outside_stalls(self) -> int | None:
        """Ticks late, lost or skipped that overlap no stall of the host; None if unwatched."""
        if self.stalled is None:
            return None
        return int(np.count_nonzero(self.missed & ~self.stalled))

    def stage(self, name: str) -> Times:
        """Length of a stage of every tick [ns], nan where it is not known.

        Besides those of `STAGES` there are `rtt`, from publication to arrival, and `unaccounted`:
        the part of the RTT that no stage covers. That is all of it where the controller's stamps
        do not follow each other, and else 0, because `network` is what remains.
        """
        return self._stages[name]

    def free_stages(self) -> None:
        """Free the memory of all stages; a later request computes them again."""
        self.__dict__.pop("_stages", None)

    def us(self, name: str) -> FloatArray:
        """A stage, or `rtt`, of every tick [µs]; NaN where there is none."""
        return np.asarray(self.stage(name) / 1e3, float)

    @cached_property
    def _stages(self) -> dict[str, Times]:
        cycles, nothing = self.cycles, np.full(len(self), np.nan)
        has_cycle = self.cycle >= 0
        stages = {
            "wakeup": between(self.intended, self.actual),
            "publish": between(self.actual, self.published),
            "rtt": between(self.published, self.arrival),
        }
        for name, values in cycle_stages(cycles).items():
            stages[name] = nothing.copy()
            stages[name][has_cycle] = values[self.cycle[has_cycle]]
        computed = stages.pop("computed")
        rest = stages["rtt"] - stages["wait"] - computed
        with np.errstate(invalid="ignore"):
            too_long = stages["send"] > rest  # the answer had arrived before the link said so
        stages["send"][too_long] = np.maximum(rest[too_long], 0.0)
        stages["network"] = rest - np.nan_to_num(stages["send"])
        stages["unaccounted"] = np.where(np.isnan(computed), stages["rtt"], 0.0)
        stages["unaccounted"][self.arrival == NEVER] = np.nan
        return stages

    @cached_property
    def attributed_stages(self) -> dict[int, str]:
        """The stage that each miss is attributed to, by tick.

        Returns:
            for each tick that is late, lost or skipped, the first of these that applies:

            `host`: it overlaps a stall of the host, and no stage of the controller would have
                exceeded its usual length by a whole period without the stalls.
            `wakeup`: it was skipped; the robot itself slept or worked through it.
            `rejected`: an answer came, and the robot refused it.
            a stage: for a late one, that which exceeded its median over the ticks in time by
                most. For one that the controller never saw because it was busy with an earlier
                one, the stage that held up that one.
            `network`: its answer was sent and never arrived, or its State never reached the
                controller although that was free.
            `silent`: the controller had its State and sent nothing.
            `no answer`: all that is known. So without the controller's log for every lost tick
                that no late answer explains.
        """
        return attribute_misses(self, (*STAGES, "unaccounted")) if self.missed.any() else {}

    def attributed_counts(self) -> dict[str, int]:
        """Count the misses by the stage that they are attributed to, most first."""
        names, counts = np.unique(list(self.attributed_stages.values()), return_counts=True)
        pairs = sorted(zip(names.tolist(), counts.tolist(), strict=True), key=lambda p: -p[1])
        return dict(pairs)

    def worst(self, n: int = 10) -> list[dict[str, Any]]:
        """The ticks with the longest RTT, longest first, in us: lost ones have none.

        Returns:
            for each `tick`, `outcome`, `rtt_us`, `stages_us` (those that are known), `stalled`
            (None if unwatched) and `guilty` (None where it was in time).
        """
        rtt = np.where(np.isnan(self.stage("rtt")), -1.0, self.stage("rtt"))
        longest = np.argsort(-rtt, kind="stable")[:n]
        return [
            {
                "tick": int(self.tick[place]),
                "outcome": OUTCOMES[self.outcome[place]],
                "rtt_us": float(rtt[place]) / 1e3,
                "stages_us": {
                    name: float(self.stage(name)[place]) / 1e3
                    for name in (*STAGES, "unaccounted")
                    if not np.isnan(self.stage(name)[place])
                },
                "stalled": None if self.stalled is None else bool(self.stalled[place]),
                "guilty": self.attributed_stages.get(int(self.tick[place])),
            }
            for place in longest.tolist()
            if rtt[place] >= 0
        ]


def _valid_answers(
    states: RowsAt, setpoints: Rows, arrivals: Stamps, description: RobotDescription
) -> Flags:
    """Which setpoints the robot took for an answer to one of its States, in time or not."""
    fits = setpoints["wire_version"] == Setpoint.schema.version
    fits &= setpoints["session_id"] == states["session_id"][0]
    fits &= np.isin(setpoints["command"], [COMMANDS[kind] for kind in description.command_kinds])
    fits &= np.isfinite(setpoints["values"][:, : description.n]).all(axis=1)
    ticks = states["tick"]
    asked = states[np.minimum(np.searchsorted(ticks, setpoints["tick"]), len(ticks) - 1)]
    fits &= (asked["tick"] == setpoints["tick"]) & (asked["mode"] == State.ACTIVE)
    fits &= asked["epoch"] == setpoints["epoch"]
    valid: Flags = fits & (arrivals >= asked["stamp_published"])
    return valid


def _arrivals(
    ticks: Stamps, answered: Stamps, arrivals: Stamps, valid: Flags
) -> tuple[Stamps, Flags]:
    """First valid answer to each tick, and whether one came that was refused."""
    arrival = np.full(len(ticks), NEVER)
    refused = np.zeros(len(ticks), bool)
    if len(ticks):
        place = _places(ticks, np.clip(answered, 0, ticks[-1] + 1).astype(np.int64))
        first_last = np.flatnonzero(valid & (place >= 0))[::-1]
        arrival[place[first_last]] = arrivals[first_last]
        refused[place[~valid & (place >= 0)]] = True
    return arrival, refused


def _stalls(events: Rows) -> list[Stall] | None:
    """Stalls of the host in a log, of all CPUs, by their start; None where nothing watched."""
    if not np.any(events["kind"] == EVENTS["STALLS_WATCHED"]):
        return None
    found = events[events["kind"] == EVENTS["HOST_STALL"]]
    found = found[np.argsort(found["stamp"], kind="stable")]
    return [
        Stall(start, start + length)
        for start, length in zip(found["stamp"].tolist(), found["detail"].tolist(), strict=True)
    ]


def _skipped(number: Stamps, counted: Any, active: Flags) -> tuple[Stamps, Stamps, Stamps]:
    """Ticks skipped between two active ones, as far as the robot counted them.

    Returns:
        their numbers, the places of the States that followed them, and by how many ticks they
        came before those.
    """
    jump = np.diff(counted.astype(np.int64))
    jump[(jump != np.diff(number) - 1) | ~active[:-1] | ~active[1:]] = 0  # or records are missing
    back = np.repeat(np.cumsum(jump), jump) - np.arange(jump.sum())
    at = np.repeat(np.arange(1, len(number)), jump)
    return number[at] - back, at, back


def _places(ticks: Stamps, wanted: Stamps) -> Stamps:
    """Where each wanted tick stands in ascending `ticks`; -1 where it does not."""
    if not len(ticks):
        return np.full(len(wanted), -1)
    place = np.minimum(np.searchsorted(ticks, wanted), len(ticks) - 1)
    return np.where(ticks[place] == wanted, place, -1)
