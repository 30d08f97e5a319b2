"""The answers of a controller of several tasks, as far as they can be recomputed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.tools.verify.claims import RELATIVE, Claims
from hoap3.tools.verify.controller_log import ControllerRun
from hoap3.tools.verify.controllers.velocity.joint_bounds import bounds_of
from hoap3.tools.verify.controllers.velocity.task_stack import Cycles, Tasks
from hoap3.tools.verify.sent_velocity import DELAYED, judged, sent_velocity

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Answers:
    """N answers, and what is known of each without the controller's own law.

    Attributes:
        run: that they are of.
        cycles: the tasks.
        u, doubt: velocity, and how exactly it is known, (N, n) [rad/s or m/s].
        lower, upper: its bounds, (N, n).
        delayed: whether the robot applies answers later: u and its bounds mean nothing then.
    """

    run: ControllerRun
    cycles: Cycles
    u: Array
    doubt: Array
    lower: Array
    upper: Array
    delayed: bool

    @property
    def tick(self) -> NDArray[np.int64]:
        """Of each, (N,)."""
        found: NDArray[np.int64] = self.run.answers["tick"].astype(np.int64)
        return found

    def check_margin(self, claims: Claims) -> None:
        """The least distance of u from a bound."""
        margin = np.minimum(self.u - self.lower, self.upper - self.u).min(1)
        size = np.maximum(np.abs(self.lower), np.abs(self.upper))
        near = (RELATIVE * size + self.doubt).max(1)
        claims.equal("margin", self.tick, self.run.answers["margin"], margin, near)


def answers_of(
    run: ControllerRun,
    settings: Mapping[str, Any],
    tasks: Tasks,
    columns: list[str],
    claims: Claims,
) -> Answers | None:
    """Those that can be recomputed, with the errors of their tasks; what cannot is counted.

    Args:
        run: what the log has.
        settings: of the controller.
        tasks: of the config.
        columns: names that `extra` must have.
        claims: takes what was compared.

    Returns:
        None where there are none.
    """
    delayed = run.description.delay_ticks > 0
    reason = ""
    if list(run.session.get("extra", ())) != columns:
        reason = "the columns are not those of its tasks"
    elif delayed and settings["kinematics_from"] == "reference":
        reason = DELAYED
    if reason:
        claims.unverified("certificate", len(run.answers), reason)
        return None
    run = judged(run, claims)
    if not len(run.answers):
        return None
    base = run.states["q" if settings["kinematics_from"] == "measured" else "reference"]
    u, doubt = sent_velocity(run, settings)
    cycles = tasks.over(run, base, u)
    stated = run.answers["extra"][:, : len(tasks.labels)]
    found = np.array([np.linalg.norm(cycles.e[:, rows], axis=1) for rows in tasks.rows]).T
    near = np.array([np.linalg.norm(tasks.places[rows]) for rows in tasks.rows])
    claims.equal("error", run.answers["tick"], stated, found, RELATIVE * np.abs(found) + near)
    return Answers(run, cycles, u, doubt, *bounds_of(run, settings["bounds"]), delayed)
