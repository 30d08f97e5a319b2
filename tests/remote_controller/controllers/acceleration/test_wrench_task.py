"""A wrench in up to six directions: its formula, its rows, when it touches, and in contact."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio
import pytest
from hierarchy_runs import content, made, state_of
from pydantic import ValidationError

from hoap3.remote_controller.tasks.accelerations import wrench_reference as reference
from hoap3.remote_controller.tasks.accelerations.wrench import (
    AXES,
    Sensed,
    TaskMotion,
    WrenchControl,
    WrenchTask,
)
from hoap3.robot_emulator.config import read_config
from hoap3.tools.services.simulate import simulate

T = 1e-3
POINT = {"kind": "point", "position_m": [-0.5, -0.25, 0.49]}
TILT = np.radians(3.0)
ORDER = {"order": ["hand", "elbow", "posture"]}
SMALL_AND_LARGE = [200, pytest.param(6000, marks=pytest.mark.long)]


def settings(**given: object) -> WrenchTask.Parameters:
    return WrenchTask.Parameters.model_validate({"frame": "ee", "target": POINT, **given})


def control(joints: int = 6, root: np.ndarray | None = None, **given: object) -> WrenchControl:
    wanted = settings(**given)
    axes = wanted.contact_axes(np.eye(3) if root is None else root)
    return WrenchControl(wanted, axes, joints, T)


def rotation(rng: np.random.Generator) -> np.ndarray:
    return np.ascontiguousarray(pinocchio.exp3(rng.normal(size=3)))


def sensed(rng: np.random.Generator, size: float = 20.0) -> Sensed:
    return Sensed(rotation(rng), size * rng.normal(size=6), *rng.normal(size=(2, 3)))


def moving(rng: np.random.Generator, m: int, n: int) -> TaskMotion:
    return TaskMotion(rng.normal(size=(m, n)), *rng.normal(size=(5, m)))


def inertia(rng: np.random.Generator, n: int) -> np.ndarray:
    root = rng.normal(size=(n, n))
    return np.ascontiguousarray(root @ root.T + 0.1 * np.eye(n))


def close(found: np.ndarray, wanted: np.ndarray, relative: float = 1e-12) -> None:
    """Within `relative` of the largest number there, or of 1."""
    size = max(1.0, float(np.abs(wanted).max()))
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=relative * size)


def compare_with_reference(rng: np.random.Generator) -> None:
    """One control of random settings over three ticks, against plain numpy.

    To 1e-11 of what B = J M⁻¹ Jᵀ and the missing wrench can ask for, from which the held directions
    P take away; but where these are nearly dependent: the reference inverts P B Pᵀ, which loses as
    many digits as its condition number κ has, hence 1e-14·κ.
    """
    n, k = int(rng.integers(1, 9)), int(rng.integers(1, 7))
    axes = [AXES[i] for i in rng.permutation(6)[:k]]
    wanted, most = 10.0 * rng.normal(size=k), 2.0 * rng.random(k)
    kp, ki, kd = rng.random(3) * [2.0, 50.0, 5.0]
    turn, root, normal = rng.normal(size=3), rotation(rng), rng.normal(size=3)
    gains = {"force_kp": kp, "force_ki_per_s": ki, "force_kd": kd, "integral_max": list(most)}
    form = {"axes_rad": list(turn)} if rng.random() < 0.5 else {"normal": list(normal)}
    more = {"rotation_rad": "hold"} if rng.random() < 0.5 else {}
    each = control(n, root, axes=axes, wrench=list(wanted), touch_n=1e-6, **gains, **form, **more)
    contact = root @ pinocchio.exp3(turn) if "axes_rad" in form else each_axes(root, normal)
    oriented = bool(more) or any(axis.startswith("r") for axis in axes)
    both = np.kron(np.eye(2), contact).T
    P = both[[axis not in axes for axis in AXES]] if oriented else np.zeros((0, 3))
    S = both[[AXES.index(axis) for axis in axes], : 6 if oriented else 3]
    close(each.S, S)
    integral = np.zeros(k)
    for _ in range(3):
        M, feels, task = inertia(rng, n), sensed(rng), moving(rng, S.shape[1], n)
        before = [array.copy() for array in task]
        each.feel(feels, 0.0)
        measured = S @ reference.wrench_about(*feels)[: S.shape[1]]
        close(each.measured, measured)
        if each._learns:
            integral = np.clip(integral + ki * T * (wanted - measured), -most, most)
        each.touches = True
        each.update(M, task)
        _, drift, error, motion, _, asked = before
        aimed = reference.aimed(wanted, measured, kp, integral)
        inverse = reference.inverse_task_inertia(M, before[0], S, P)
        found = reference.wanted_acceleration(
            S, inverse, measured - aimed, kd, motion, drift, asked
        )
        across = np.eye(S.shape[1]) - S.T @ S
        B = before[0] @ np.linalg.solve(M, before[0].T)
        size = np.linalg.norm(B, 2) * np.linalg.norm(measured - aimed)
        share = max(1e-11, 1e-14 * condition(P @ B @ P.T))
        np.testing.assert_allclose(task.wanted, found, rtol=0.0, atol=share * max(1.0, size))
        close(task.error, across @ error)
        close(task.motion, across @ motion)
        np.testing.assert_array_equal(task.slope, -task.error)


def condition(matrix: np.ndarray) -> float:
    """Of the part that is not singular to rounding, as `wrench_reference` takes it."""
    values = np.linalg.svd(matrix, compute_uv=False) if matrix.size else np.ones(1)
    return float(values[0] / values[values > 1e-11 * values[0]][-1])


def each_axes(root: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The contact's axes of a normal: z along it, x as near to the reference's as it can be."""
    z = root @ normal / np.linalg.norm(normal)
    x = root[:, 0] if abs(root[:, 0] @ z) <= 0.9 else root[:, 1]
    x = x - z * (x @ z)
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


@pytest.mark.parametrize("count", SMALL_AND_LARGE)
def test_it_asks_for_what_the_formula_says(count):
    rng = np.random.default_rng(3)
    for _ in range(count):
        compare_with_reference(rng)


def test_a_torque_is_taken_to_the_origin_of_the_tasks_frame():
    """5 N along z, felt 0.2 m beside it along x: −1 N m about y, and what the sensor feels."""
    each = control(axes=["z", "rx", "ry"], wrench=[5.0, 0.0, 0.0])
    wrench = np.array([0.0, 0.0, 5.0, 0.3, 0.0, 0.0])
    each.feel(Sensed(np.eye(3), wrench, np.array([0.2, 0.0, 0.0]), np.zeros(3)), 0.0)
    np.testing.assert_allclose(each.measured, [5.0, 0.3, -1.0], rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("axes", "wanted", "force", "touches"),
    [
        (["x", "y", "z"], [0.0, 0.0, 10.0], [3.0, 0.0, 0.4], False),  # only rubs
        (["x", "y", "z"], [0.0, 0.0, 10.0], [0.0, 0.0, -3.0], False),  # is pulled
        (["x", "y", "z"], [0.0, 0.0, 10.0], [0.0, 0.0, 0.6], True),
        (["z"], [-5.0], [0.0, 0.0, -0.6], True),
        (["z"], [-5.0], [0.0, 0.0, 0.6], False),
        (["x", "y"], [0.0, 0.0], [0.0, 0.4, -0.4], True),  # of no wanted force: in any direction
        (["rx"], [1.0], [0.3, 0.0, 0.0], False),
        (["rx"], [1.0], [0.0, 0.0, 0.6], True),
    ],
)
def test_it_touches_where_the_wanted_force_is_felt(axes, wanted, force, touches):
    each = control(axes=axes, wrench=wanted)
    each.feel(Sensed(np.eye(3), np.array([*force, 0.0, 0.0, 0.0]), *np.zeros((2, 3))), 0.0)
    assert each.touches == touches


def asked(each: WrenchControl, wrench: list[float], absent: float = 0.0) -> np.ndarray:
    """Accelerations that are asked for of a unit mass and inertia, at rest in the root's axes."""
    each.feel(Sensed(np.eye(3), np.array(wrench), *np.zeros((2, 3))), absent)
    task = TaskMotion(np.eye(6), *np.zeros((5, 6)))
    each.update(np.eye(6), task)
    return task.wanted


def test_each_integral_stops_at_its_own_greatest():
    wanted = {"axes": ["z", "x", "rx", "ry"], "wrench": [10.0, 0.0, 0.0, 0.5]}
    for more, most in (
        ({}, [10.0, 10.0, 0.5, 0.5]),
        ({"integral_max": [1.0, 2.0, 0.0, 0.1]}, [1.0, 2.0, 0.0, 0.1]),
    ):
        each = control(force_ki_per_s=50.0, **wanted, **more)
        felt = [2.0, 0.0, 1.0, 0.2, -0.5, 0.0]
        missing = np.array(wanted["wrench"]) - [1.0, 2.0, 0.2, -0.5]
        first = asked(each, felt)  # which has counted for one period
        for _ in range(5000):
            last = asked(each, felt)
        begun = np.clip(50.0 * T * missing, np.negative(most), most)
        grown = (first - last)[[2, 0, 3, 4]] + begun
        np.testing.assert_allclose(grown, np.sign(missing) * most, rtol=1e-9, atol=1e-9)


def test_a_task_that_is_out_forgets_all_its_integrals():
    given = {"axes": ["z", "rx"], "wrench": [10.0, 1.0]}
    each, felt = control(**given), [0.0, 0.0, 4.0, 0.1, 0.0, 0.0]
    for _ in range(300):
        last = asked(each, felt)
    assert (np.abs(last - asked(control(**given), felt))[[2, 3]] > 0.1).all()
    each.feel(Sensed(np.eye(3), np.zeros(6), *np.zeros((2, 3))), 1.0)
    assert not each.touches
    np.testing.assert_array_equal(asked(each, felt), asked(control(**given), felt))


WRONG = [
    ({}, "`axes` and `wrench`"),
    ({"force_n": 5.0}, "`normal` and `force_n`"),
    ({"normal": [0.0, 0.0, 1.0]}, "`normal` and `force_n`"),
    ({"axes": ["z"]}, "`axes`"),
    ({"axes": ["z", "z"], "wrench": [1.0, 1.0]}, "axes"),
    ({"axes": ["z"], "wrench": [1.0], "normal": [0.0, 0.0, 1.0], "force_n": 5.0}, "`axes`"),
    ({"axes": ["z"], "wrench": [1.0], "integral_max": [1.0, 2.0]}, "`integral_max`"),
    ({"axes": ["z"], "wrench": [1.0], "integral_max": [-1.0]}, "integral_max"),
    ({"axes": ["z"], "wrench": [1.0], "normal": [0.0] * 3}, "normal"),
    (
        {"axes": ["z"], "wrench": [1.0], "normal": [0.0, 0.0, 1.0], "axes_rad": [0.0] * 3},
        "normal and axes_rad",
    ),
]


@pytest.mark.parametrize(("given", "said"), WRONG)
def test_what_does_not_fit_together_is_refused(given, said):
    with pytest.raises(ValidationError) as raised:
        settings(**given)
    assert said in str(raised.value)


def hand(**parameters: object) -> dict[str, object]:
    given = {"frame": "ee", "target": POINT, **parameters}
    return {"name": "hand", "task": "wrench", "kp": 30.0, "kd": 20.0, "parameters": given}


def others() -> list[Any]:
    return list(content("ghc_force")["parameters"]["tasks"][1:])


FLAT = {"axes": ["z", "rx", "ry"], "wrench": [10.0, 0.0, 0.0]}


def test_each_direction_has_a_column_and_an_error_with_its_unit():
    controller = made("ghc_force", tasks=[hand(**FLAT), *others()])
    names = controller.extra_names
    start = names.index("force_hand")
    assert names[start : start + 3] == ("force_hand", "wrench_hand_rx", "wrench_hand_ry")
    torque_first = control(axes=["rz", "x"], wrench=[0.0, 0.0])
    assert torque_first.columns("hand") == ["wrench_hand_rz", "wrench_hand_x"]
    q = np.array(controller.description.postures["bent"])
    state = state_of(controller, q, np.zeros(q.size))
    dynamics = controller.tasks.dynamics
    state.wrench[:] = np.concatenate([dynamics.placement(q, "ee")[1].T @ v for v in np.eye(3)[1:]])
    command = controller.step(state)
    np.testing.assert_allclose(command.extra[start : start + 3], [0.0, 0.0, 0.0], atol=1e-12)
    errors = [each for each in controller.task_errors() if each.task == "hand"]
    assert [each.unit for each in errors] == ["m", "deg", "N", "N m", "N m"]
    assert [each.error for each in errors[2:]] == pytest.approx([10.0, 0.0, 0.0], abs=1e-12)
    assert [each.tolerance for each in errors[2:]] == pytest.approx([0.5, 0.05, 0.05])


def test_six_rows_move_as_they_say_before_the_touch():
    """d/dt ν = J·ddq + rate and d/dt ½|e|² = slope·ν, by central differences."""
    given = {**FLAT, "rotation_rad": [0.4, -0.9, 0.7]}
    controller = made("ghc_force", tasks=[hand(**given), *others()])
    tasks, rng, h = controller.tasks, np.random.default_rng(5), 1e-5
    mine, none, absent = tasks.rows[0], np.zeros(6), np.zeros(3)
    assert tasks.sizes[0] == 6
    for _ in range(20):
        q, dq, ddq = 0.7 * rng.normal(size=(3, 7))
        tasks.begin(q, dq, 0.0, 1e-3)
        motion, value = [], []
        for t in (-h, h):
            tasks.update(
                q + t * dq + 0.5 * t * t * ddq, dq + t * ddq, none, 0.5 + t, 0.501 + t, absent
            )
            motion.append(tasks.motion[mine].copy())
            value.append(0.5 * float(tasks.error[mine] @ tasks.error[mine]))
        tasks.update(q, dq, none, 0.5, 0.501, absent)
        rate = tasks.jacobian[mine] @ ddq + tasks.rate[mine]
        close((motion[1] - motion[0]) / (2.0 * h), rate, 1e-6)
        slope = float(tasks.slope[mine] @ tasks.motion[mine])
        assert (value[1] - value[0]) / (2.0 * h) == pytest.approx(slope, rel=1e-6, abs=1e-6)
        asking = 30.0 * tasks.error[mine] - 20.0 * tasks.motion[mine] - tasks.rate[mine]
        close(tasks.wanted[mine], asking)


def test_the_orientation_leads_to_the_one_that_is_asked_for():
    given = {**FLAT, "rotation_rad": [0.4, -0.9, 0.7]}
    tasks = made("ghc_force", tasks=[hand(**given), *others()]).tasks
    held = made("ghc_force", tasks=[hand(**FLAT), *others()]).tasks
    rng, goal = np.random.default_rng(6), pinocchio.exp3(np.array([0.4, -0.9, 0.7]))
    for _ in range(20):
        start, q = rng.normal(size=(2, 7))
        first = tasks.dynamics.placement(start, "ee")[1]
        present = tasks.dynamics.placement(q, "ee")[1]
        for each, wanted in ((tasks, goal), (held, first)):
            each.begin(start, np.zeros(7), 0.0, T)
            each.update(q, np.zeros(7), np.zeros(6), T, 2.0 * T, np.zeros(3))
            found = pinocchio.exp3(each.error[3:6])
            np.testing.assert_allclose(found @ present, wanted, rtol=0, atol=1e-9)


def test_rows_are_turned_into_the_roots_axes_with_their_rates():
    from hoap3.remote_controller.tasks.accelerations.wrench_kernels import turn_to_root

    rng = np.random.default_rng(7)
    for _ in range(200):
        R, J, (twist, drift) = rotation(rng), rng.normal(size=(6, 5)), rng.normal(size=(2, 6))
        wanted = reference.in_root_axes(R, J, twist, drift)
        turn_to_root(R, J, twist, drift)
        for found, each in zip((J, twist, drift), wanted, strict=True):
            close(found, each)


def over_a_sole(seconds: float = 4.0, priorities: Any = ORDER, **parameters: Any) -> Any:
    """The hand comes down on four corners, 3° about x from flat; its log's columns."""
    emulator, _ = read_config("lwr_with_table")
    one = {"frame": "ee", "point_m": [0.0, 0.0, 0.45], "normal": [0.0, 0.0, 1.0], "friction": 0.3}
    corners = [(x, y) for x in (-0.02, 0.02) for y in (-0.02, 0.02)]
    contacts = [{**one, "stiffness_n_m": 2e4, "offset_m": [x, y, 0.0]} for x, y in corners]
    emulator = {**emulator, "plant": {**emulator["plant"], "contacts": contacts}}
    down = pinocchio.exp3(np.array([TILT, 0.0, 0.0])) @ np.diag([-1.0, 1.0, -1.0])
    target = {"kind": "point", "position_m": [-0.55, -0.2, 0.44], "approach_s": 3.0}
    rest = {"rotation_rad": list(pinocchio.log3(down)), "target": target, "force_kd": 10.0}
    tasks = [hand(**rest, **parameters), *others()]
    done = simulate(emulator, content("ghc_force", tasks=tasks, priorities=priorities), seconds)
    names, extra = done.controller.extra_names, done.setpoints["extra"]
    return done, {name: extra[:, place] for place, name in enumerate(names)}


@pytest.mark.slow
@pytest.mark.parametrize("torques", [(0.0, 0.0), (0.06, -0.04)])
def test_a_sole_lies_down_flat_and_presses_where_it_is_told(torques):
    """The corners' springs yield to the torque by what they are stiff: 4·K·(2 cm)² [N m/rad]."""
    done, columns = over_a_sole(axes=["z", "rx", "ry"], wrench=[10.0, *torques])
    assert columns["force_hand"].max() < 30.0
    assert columns["force_hand"][-1] == pytest.approx(10.0, rel=0.01)
    for name, torque in zip(("rx", "ry"), torques, strict=True):
        assert columns[f"wrench_hand_{name}"][-1] == pytest.approx(torque, abs=1e-3)
    z = done.controller.tasks.dynamics.rotations[0][:, 2]
    yielding = math.hypot(*torques) / (4.0 * 2e4 * 0.02**2)
    assert math.acos(-z[2]) == pytest.approx(yielding, abs=5e-4)
    errors = [each for each in done.controller.task_errors() if each.task == "hand"]
    assert [each.unit for each in errors] == ["m", "deg", "N", "N m", "N m"]
    assert all(each.within for each in errors)


def test_a_force_across_the_normal_that_shall_be_none_lets_the_hand_go_there():
    """Along y it keeps its place; along x the same target pulls no longer."""
    tasks = [hand(axes=["z", "x"], wrench=[10.0, 0.0], force_kd=5.0), *others()]
    done = simulate("lwr_with_table", content("ghc_force", tasks=tasks, priorities=ORDER), 3.0)
    names, extra = done.controller.extra_names, done.setpoints["extra"][-1]
    assert extra[names.index("force_hand")] == pytest.approx(10.0, rel=0.01)
    assert extra[names.index("wrench_hand_x")] == pytest.approx(0.0, abs=0.05)
    x, y, _ = done.controller.tasks.dynamics.origins[0]
    assert abs(y + 0.25) < 1e-3
    assert abs(x + 0.5) > 5e-3


@pytest.mark.slow
def test_put_in_again_it_lies_down_as_gently_as_at_first():
    out = {"at_s": 3.2, "remove": "hand", "over_s": 0.2}
    back = {"at_s": 3.8, "insert": "hand", "over_s": 0.2}
    given = {"axes": ["z", "rx", "ry"], "wrench": [10.0, 0.0, 0.0]}
    _, columns = over_a_sole(6.0, {**ORDER, "timeline": [out, back]}, **given)
    force = columns["force_hand"]
    assert force[3500:3800].min() == 0.0
    assert force[3800:].max() < 1.5 * force[:3200].max()
    assert force[-1] == pytest.approx(10.0, rel=0.02)
