"""The force of a task: what it asks for, what its integral learns, and when it forgets."""

from __future__ import annotations

import numpy as np
import pytest
from hierarchy_runs import content, made, state_of

from hoap3.remote_controller.tasks.accelerations.wrench import (
    Sensed,
    TaskMotion,
    WrenchControl,
    WrenchTask,
)
from hoap3.tools.services.simulate import simulate

UP = np.array([0.0, 0.0, 1.0])
T = 1e-3


def press(**settings: float) -> WrenchControl:
    """Of 10 N, at once against a unit mass: J = M = I."""
    given = {"frame": "ee", "normal": (0.0, 0.0, 1.0)}
    given |= {"target": {"kind": "point", "position_m": (0.0, 0.0, 0.0)}, "force_n": 10.0}
    wanted = WrenchTask.Parameters.model_validate({**given, **settings})
    return WrenchControl(wanted, wanted.contact_axes(np.eye(3)), 3, T)


def feel(each: WrenchControl, force: float, absent: float) -> None:
    """A force along z, at the origin of the task's frame."""
    wrench = np.array([0.0, 0.0, force, 0.0, 0.0, 0.0])
    each.feel(Sensed(np.eye(3), wrench, np.zeros(3), np.zeros(3)), absent)


def asked(each: WrenchControl, force: float, speed: float = 0.0, absent: float = 0.0) -> float:
    """Acceleration along the normal that is asked for [m/s²]."""
    feel(each, force, absent)
    task = TaskMotion(np.eye(3), np.zeros(3), np.zeros(3), speed * UP, np.zeros(3), np.zeros(3))
    each.update(np.eye(3), task)
    return float(task.wanted[2])


def test_it_presses_with_what_is_wanted_and_the_surface_takes_away():
    assert asked(press(force_ki_per_s=0.0), 4.0) == pytest.approx(4.0 - 10.0)


def test_kp_presses_harder_where_force_is_missing():
    """Liu, Tan and Padois (2015), 6.2: f_d + kp·(f_d − f)."""
    assert asked(press(force_ki_per_s=0.0, force_kp=2.0), 4.0) == pytest.approx(4.0 - 22.0)


def test_kd_brakes_along_the_normal():
    soft, damped = press(force_ki_per_s=0.0), press(force_ki_per_s=0.0, force_kd=3.0)
    for speed in (-0.5, 0.5):
        change = asked(damped, 10.0, speed) - asked(soft, 10.0, speed)
        assert change == pytest.approx(-3.0 * speed)


def test_the_integral_adds_at_most_the_wanted_force_either_way():
    for force, most in ((1.0, -19.0), (25.0, 25.0)):
        each = press(force_ki_per_s=50.0)
        found = [asked(each, force) for _ in range(2000)]
        assert found[-1] == pytest.approx(most)
        assert abs(found[0]) < 24.0


@pytest.mark.parametrize(("force", "absent"), [(1.0, 0.5), (0.0, 0.0)])
def test_the_integral_learns_nothing_while_the_task_fades_or_feels_nothing(force, absent):
    each = press()
    begun = asked(each, 1.0)
    for _ in range(500):
        last = asked(each, force, absent=absent)
    assert last == pytest.approx(begun + force - 1.0)


def test_a_task_that_is_out_forgets_that_it_touched():
    each = press()
    for _ in range(500):
        asked(each, 1.0)
    feel(each, 0.0, 1.0)
    assert not each.touches
    feel(each, 1.0, 0.0)
    assert each.touches
    assert asked(each, 10.0) == pytest.approx(0.0, abs=1e-9)


def test_a_controller_that_begins_anew_has_forgotten_what_it_felt():
    controller = made("ghc_force", priorities={"order": ["hand", "elbow", "posture"]})
    q = np.array(controller.description.postures["bent"])

    def first(force: float) -> np.ndarray:
        state = state_of(controller, q, np.zeros(q.size))
        state.wrench[2] = force
        return controller.step(state).values.copy()

    fresh = first(0.0)
    touching = state_of(controller, q, np.zeros(q.size))
    along = controller.tasks.dynamics.rotations[-1].T @ UP
    touching.wrench[:3] = 5.0 * along
    for touching.tick in range(200):
        controller.step(touching)
    assert controller.tasks.presses[0].touches
    np.testing.assert_array_equal(first(0.0), fresh)


@pytest.mark.slow
def test_a_hand_that_is_taken_out_and_put_in_again_comes_down_as_gently_as_at_first():
    out = {"at_s": 1.5, "remove": "hand", "over_s": 0.2}
    back = {"at_s": 2.2, "insert": "hand", "over_s": 0.2}
    priorities = {"order": ["hand", "elbow", "posture"], "timeline": [out, back]}
    done = simulate("lwr_with_table", content("ghc_force", priorities=priorities), 4.0)
    place = done.controller.extra_names.index("force_hand")
    force = done.setpoints["extra"][:, place]
    assert force[1700:2200].min() == 0.0  # it did let go
    assert force[2200:].max() < 1.5 * force[:1500].max()
    assert force[-1] == pytest.approx(10.0, rel=0.02)


def test_the_shipped_hand_touches_with_little_more_than_it_presses_with():
    done = simulate("lwr_with_table", content("ghc_force"), 1.2)
    force = done.setpoints["extra"][:, done.controller.extra_names.index("force_hand")]
    assert 10.0 < force.max() < 14.0
    assert force[-1] == pytest.approx(10.0, rel=0.02)
