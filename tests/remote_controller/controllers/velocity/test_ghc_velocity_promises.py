"""`ghc_velocity`: what its settings promise, and when it has nothing to certify."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from ranked_runs import COM, FOOT, FREE, HOAP3, POSTURE, answer, controller, motion
from support.solvers.one_shot import ghc

from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.controllers.velocity.ghc_velocity import CONDITIONS


@pytest.mark.parametrize("smoothing", [0.0, 0.3])
def test_smoothing_is_the_solvers(smoothing):
    tasks = [{**task, "gain_per_s": 0.2} for task in (COM, FOOT, POSTURE)]
    order = {"order": ["com", "foot", "posture"]}
    given = {"bounds": FREE, "smoothing": smoothing, "regularisation": 1e-4}
    made = controller(*tasks, priorities=order, **given)
    u = answer(made, np.array(HOAP3.postures["walk_ready"]))
    wanted = 0.2 * made.errors + made.rates
    rows = [slice(*ends) for ends in pairwise(made.offsets.tolist())]
    problem = [made.jacobian[mine] for mine in rows], [wanted[mine] for mine in rows]
    rest = np.tril(np.ones((3, 3)), -1), np.eye(HOAP3.n), np.zeros(HOAP3.n), 1e-4
    same, other = (
        ghc(*problem, *rest, regularise="none", smoothing=width)[0]
        for width in (smoothing, 0.3 - smoothing)
    )
    assert made.command.solver_path == 0
    np.testing.assert_allclose(u, same, rtol=0, atol=1e-9)
    assert np.abs(u - other).max() > 1e-3


def test_where_no_task_takes_part_it_is_at_no_target():
    """V of nobody is 0, which is no merit; HOAP-3 stands 2 cm beside its target here."""
    made = controller(
        COM, POSTURE, priorities={"order": ["com", "posture"], "inactive": ["com", "posture"]}
    )
    found = motion(made, 5, {3: lambda: made.change({"insert": "com"})})
    assert (found["extra"][:3, 0] > 0.01).all()
    assert (found["status"][:3] == STATUS["uncertified"]).all()
    idle = found["present"] >> CONDITIONS.index("no task takes part") & 1
    assert idle.tolist() == [1, 1, 1, 0, 0]
