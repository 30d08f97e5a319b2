"""`stable_qp`: V, V̇, ρ, margin and optimality of problem (3), whatever its task and constraints.

Gonçalves et al., IEEE T-RO 2020, sections II and III.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import FrameNotFoundError
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.problems.oracles.constraints.cycles_oracle import Cycles
from hoap3.remote_controller.problems.oracles.constraints.stack_oracle import constraints_of
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.remote_controller.problems.oracles.tasks.config_oracle import default_entry, task_of
from hoap3.remote_controller.problems.oracles.tasks.curve_oracle import CURVES, Curve
from hoap3.remote_controller.problems.stable_qp_settings import Settings
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.controller_log import ControllerRun
from hoap3.tools.verify.sent_velocity import check_values
from support.oracles.stable_qp_arrays.answers import Answers
from support.oracles.stable_qp_arrays.certificate import check_certificate
from support.oracles.stable_qp_arrays.cycles import cycles_of
from support.oracles.stable_qp_arrays.problem import CHUNK, Cycle, Problems
from support.oracles.stable_qp_arrays.proof import check_proof
from support.oracles.stable_qp_arrays.scaled import Objective

DELAYED = "answers are delayed: where u starts from is not in the log"


def check(run: ControllerRun, parameters: Mapping[str, Any], claims: Claims) -> None:
    """Everything that the certificate of `stable_qp` says."""
    try:
        _check(run, parameters, claims)
    except (UnverifiableError, FrameNotFoundError) as error:
        claims.unverified("certificate", len(run.answers), f"{error!s:.120}")


def _check(run: ControllerRun, parameters: Mapping[str, Any], claims: Claims) -> None:
    settings, delayed = Settings.of(parameters), run.description.delay_ticks > 0
    if delayed and settings.rest["kinematics_from"] == "reference":
        raise UnverifiableError(DELAYED)
    _, unknown = constraints_of(settings.constraints, Robot(run.description, run.messages))
    cycles = cycles_of(run)
    judged = cycles.answers >= 0
    lost = len(run.answers) - int(judged.sum())
    reason = "not finite, or the log lacks when the controller began"
    claims.unverified("certificate", lost, reason)
    if not judged.any():
        return
    sent = Answers.of(run, cycles, settings.rest)
    for name, why in unknown.items():
        claims.unverified(f"constraint {name}", int(judged.sum()), why)
    if delayed:
        claims.unverified("u", int(judged.sum()), DELAYED)
    else:
        kept = np.zeros(len(run.answers), bool)
        kept[cycles.answers[judged]] = True
        check_values(run.only(kept), settings.rest, claims)
    for states, given in run.settings(parameters):
        these = states[cycles.places]
        if (these & judged).any():
            of_some = Settings.of(given)
            _check_some(
                run, cycles, these, of_some, sent, claims, proved=not delayed and not unknown
            )


def _check_some(
    run: ControllerRun,
    cycles: Cycles,
    these: NDArray[np.bool_],
    settings: Settings,
    sent: Answers,
    claims: Claims,
    *,
    proved: bool,
) -> None:
    """Check some of the cycles, those of one set of parameters.

    Args:
        run, cycles, sent: all of them.
        these: which are checked, (N,).
        settings: theirs.
        claims: takes what was compared.
        proved: whether the optimum can be recomputed, too.
    """
    robot = Robot(run.description, run.messages)
    entry = settings.task or default_entry(run.description)
    on_curve = entry["task"] in CURVES
    task = Curve(entry, robot) if on_curve else task_of(entry, robot)
    constrained = bool(settings.constraints) or on_curve
    objective = _objective(settings, run.description, constrained=constrained)
    constraints, _ = constraints_of(settings.constraints, robot)
    problems = Problems(run, cycles, these, task, constraints, settings, robot)
    delayed = run.description.delay_ticks > 0
    for chunk in _chunks(problems):
        check_certificate(chunk, sent, settings, claims, u_known=not delayed)
        if proved:
            margins = problems.margins()
            check_proof(
                chunk,
                sent,
                margins,
                settings,
                objective,
                run.description,
                claims,
                on_curve=on_curve,
            )


def _chunks(problems: Problems) -> Iterator[list[Cycle]]:
    chunk: list[Cycle] = []
    for cycle in problems:
        chunk.append(cycle)
        if len(chunk) == CHUNK:
            yield chunk
            chunk = []
    if chunk:
        yield chunk


def _objective(
    settings: Settings, description: RobotDescription, *, constrained: bool
) -> Objective:
    try:
        names = description.joint_names
        return Objective.of(settings.objective, names, constrained=constrained)
    except (TypeError, ValueError) as error:
        raise UnverifiableError(f"objective: {error!s:.80}") from error
