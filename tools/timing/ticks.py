"""What became of every tick of a run, from its logs, and whose fault each miss was.

The time from the intended start of a tick to the arrival of its answer is cut into stages:

    wakeup · publish · wait · decode · kinematics · solve · encode · send · network

`wakeup` and `publish` are the robot's: until it woke, and until it had published its State.
`wait` is how long the State waited for the controller to end an earlier cycle. The next five are
the controller's. `network` is what remains of the RTT, both ways together: sockets, link threads,
and all the time in which the controller could run but did not. docs/concepts.md has the words.

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

from hoap3.protocol.messages import State
from hoap3.tools.machine.stalls import GRID_NS, Stall
from hoap3.tools.timing.miss_attribution import Blame, Times, between, cycle_stages
from hoap3.tools.timing.tick_logs import NEVER, Cycles, Flags, RobotSide, Stamps, answers

IN_TIME, LATE, LOST, SKIPPED = range(4)
OUTCOMES = ("in time", "late", "lost", "skipped")
STAGES = (
    "wakeup", "publish", "wait", "decode", "kinematics", "solve", "encode", "send", "network",
)  # fmt: skip
"""In the order of time. RTT is the sum of all from `wait` on, where nothing is unaccounted."""

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
        robot = RobotSide.read(folder)
        return cls.of(robot, Cycles.read(folder, robot))

    @classmethod
    def of(cls, robot: RobotSide, cycles: Cycles) -> TickTable:
        """The same from what was read."""
        states, period = robot.states, robot.period
        active = states["mode"] == State.ACTIVE
        number = states["tick"].astype(np.int64)
        asked = states[active]
        ticks = number[active]
        arrival, refused = _arrivals(robot, ticks)
        intended = asked["stamp_intended"]
        begin = asked["stamp_published"] if robot.from_publication else intended
        deadline = begin + robot.due
        outcome = np.where(arrival <= deadline, IN_TIME, LATE)
        outcome[arrival == NEVER] = LOST
        known = (deadline <= states["stamp_intended"][-1]) | (outcome == IN_TIME)
        rows = {
            "tick": ticks,
            "intended": intended,
            "actual": asked["stamp_actual"],
            "published": asked["stamp_published"],
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
        return cls(
            period=period,
            due=robot.due,
            from_publication=robot.from_publication,
            **whole,
            cycles=cycles,
            cycle=_places(cycles.tick, whole["tick"]),
            stalls=robot.stalls,
            lockstep=robot.lockstep,
            messages=robot.messages,
            safe_stops=robot.safe_stops,
            misses_to_stop=robot.misses_to_stop,
            left_out=robot.left_out,
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
    def rule(self) -> dict[str, Any]:
        """What is late, as the robot's description says: `deadline` and `delay_ticks`."""
        deadline = "after_receipt" if self.from_publication else "next_tick"
        return {"deadline": deadline, "delay_ticks": self.due // self.period - 1}

    @property
    def misses(self) -> int:
        """Ticks that asked, and whose answer was late or lost."""
        return self.count(LATE) + self.count(LOST)

    @property
    def success_rate(self) -> float | None:
        """Answers in time among the ticks that asked; None where none did."""
        asked = int(np.count_nonzero(self.asked))
        return self.count(IN_TIME) / asked if asked else None

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
    def _blame(self) -> Blame:
        return Blame(self, (*STAGES, "unaccounted"))

    def guilty(self) -> dict[int, str]:
        """Whose fault each miss is, by tick.

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
        return self._blame.guilty()

    def guilty_counts(self) -> dict[str, int]:
        """How many misses each has to answer for, most first."""
        names, counts = np.unique(list(self.guilty().values()), return_counts=True)
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
        guilty = self.guilty()
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
                "guilty": guilty.get(int(self.tick[place])),
            }
            for place in longest.tolist()
            if rtt[place] >= 0
        ]


def _arrivals(robot: RobotSide, ticks: Stamps) -> tuple[Stamps, Flags]:
    """First valid answer to each tick, and whether one came that was refused."""
    arrival = np.full(len(ticks), NEVER)
    refused = np.zeros(len(ticks), bool)
    if len(ticks):
        valid = answers(robot)
        number = np.clip(robot.setpoints["tick"], 0, ticks[-1] + 1).astype(np.int64)
        place = _places(ticks, number)
        first_last = np.flatnonzero(valid & (place >= 0))[::-1]
        arrival[place[first_last]] = robot.arrivals[first_last]
        refused[place[~valid & (place >= 0)]] = True
    return arrival, refused


def _skipped(number: Stamps, counted: Any, active: Flags) -> tuple[Stamps, Stamps, Stamps]:
    """Ticks skipped between two active ones, as far as the robot counted them.

    Returns:
        their numbers, the places of the States that followed them, and by how many ticks they
        came before those.
    """
    jump = np.diff(counted.astype(np.int64))
    jump[(jump != np.diff(number) - 1) | ~active[:-1] | ~active[1:]] = 0  # or records are missing
    back = np.concatenate([np.arange(n, 0, -1) for n in jump.tolist()] or [np.empty(0, int)])
    at = np.repeat(np.arange(1, len(number)), jump)
    return number[at] - back, at, back


def _places(ticks: Stamps, wanted: Stamps) -> Stamps:
    """Where each wanted tick stands in ascending `ticks`; -1 where it does not."""
    if not len(ticks):
        return np.full(len(wanted), -1)
    place = np.minimum(np.searchsorted(ticks, wanted), len(ticks) - 1)
    return np.where(ticks[place] == wanted, place, -1)
