"""The words of a report, each with its definition; docs/concepts.md has them at length."""

from __future__ import annotations

from typing import NamedTuple


class Word(NamedTuple):
    """A word and its definition."""

    name: str
    meaning: str


WORDS = {
    "tick": Word(
        "tick",
        "One period of the robot's schedule, t₀ + kT. It asks for an answer while the robot is "
        "active. Only ticks that asked, and whose deadline has passed, are counted.",
    ),
    "success": Word(
        "success rate",
        "Answers in time among the ticks that asked. Raw: all of them. Outside stalls: in "
        "time ÷ (in time + misses outside stalls), where skipped ticks are misses too. Worst "
        "window: the least of any 100 ticks in a row that asked.",
    ),
    "verdict": Word(
        "verdicts",
        "Deadlines, of the raw success rate: fit from 0.95 on, warn from 0.90 on, else unfit; also "
        "unfit after a safe stop that misses or a lost controller forced. Task: good where the "
        "error at the end is within the tolerance of each task that is judged, and 95 % of the "
        "answers are certified that the controller can certify. Limits and balance: good where the "
        "robot held no joint back, no margin of a constraint was below zero, and the centre of "
        "mass stayed above the soles on the ground. Not judged where the logs do not tell.",
    ),
    "outcome": Word(
        "in time, late, lost, skipped",
        "In time: an accepted answer had arrived by the intended start of the next tick. Late: "
        "after that. Lost: never. Skipped: the robot itself woke so late that the whole period "
        "had passed; the tick asked for nothing. A miss is late or lost.",
    ),
    "stall": Word(
        "stall of the host",
        "A time in which a monitor of the highest priority, asleep on a grid of 0.5 ms, was woken "
        "more than 0.15 ms late: the CPU itself was away, taken by the hypervisor or the firmware. "
        "A miss is the host's if it overlaps a stall, or the 0.5 ms before it was seen. Without "
        "real-time rights nobody watches: a stall could not be told from load.",
    ),
    "guilty": Word(
        "who is to blame",
        "For each tick that is late, lost or skipped: the host, where it overlaps a stall; else "
        "the stage that exceeded its own median by most, also where it held up an earlier tick "
        "for which this one had to wait.",
    ),
    "rtt-word": Word(
        "RTT",
        "From the publication of State k to the arrival of the answer to it, both stamps on the "
        "robot's clock. Lost answers have none.",
    ),
    "wakeup-word": Word(
        "wake-up latency, jitter",
        "Actual less intended start of a tick. Jitter is the deviation of the time between two "
        "wake-ups from T: its standard deviation, and of its size p99.9 − p50 and maximum.",
    ),
    "stage": Word(
        "stages",
        "wakeup, publish: the robot's, until it woke and until the State was out. wait: the State "
        "waited for the controller to end an earlier cycle. decode, kinematics, solve, encode, "
        "send: the controller's, on its own clock. network: what remains of the RTT, both ways "
        "together, with all the time in which the controller could run but did not.",
    ),
    "percentile": Word(
        "n, p50 … p99.9",
        "n values; half of them are at most p50, 99 in 100 at most p99. p99.99 is given from "
        "n = 100 000 on. No warm-up is removed. A maximum that was seen is not a bound.",
    ),
    "certificate": Word(
        "certificate",
        "What the controller proves of each answer: V, the decrease Ψ that was required, the "
        "decrease that the answer gives by the model, and that no limit was broken.",
    ),
    "condition": Word(
        "condition",
        "What the controller itself names, and sees begin and end: what holds it up, or stands in "
        "the way of a certificate, such as contradictory constraints.",
    ),
    "soft": Word(
        "soft real time",
        "What an ordinary kernel and CPython give. Nothing here is a bound, or a safety function "
        "in the sense of any norm.",
    ),
}
"""By anchor."""
