"""Contact with compliant planes, against closed forms, conservation laws and Pinocchio."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from touching import T, arm, floor, force, guided, touching

from hoap3.protocol.robot.pinocchio_model import build_model
from hoap3.robot_emulator.plants.contact_kernels import CREEP

pytestmark = pytest.mark.slow

BOUNCY = {"stiffness_n_m": 2e4, "damping_n_s_m": 20.0}
numbers = st.floats(-1.0, 1.0)
directions = st.tuples(numbers, numbers, numbers).filter(lambda v: np.linalg.norm(v) > 0.1)


def logarithmic(least: float, most: float) -> st.SearchStrategy[float]:
    return st.floats(np.log10(least), np.log10(most)).map(lambda x: float(10.0**x))


def spring_and_damper(mass: float, speed: float, stiffness: float, damping: float):
    """Depth x of m·x″ + D·x′ + K·x = 0 from x = 0, x′ = speed: greatest depth, time and exit speed.

    The exit is where K·x + D·x′ = 0, as the plane does not pull.
    """
    rate = damping / (2 * mass)
    wave = np.sqrt(stiffness / mass - rate**2)
    t = np.linspace(0.0, np.pi / wave, 2_000_001)[1:]
    decay = np.exp(-rate * t)
    x = speed / wave * decay * np.sin(wave * t)
    dx = speed * decay * (np.cos(wave * t) - rate / wave * np.sin(wave * t))
    end = int(np.argmax(stiffness * x + damping * dx <= 0.0)) or t.size - 1
    return x.max(), t[end], -dx[end]


@pytest.mark.parametrize("damping", [20.0, 283.0])
def test_an_impact_is_that_of_a_spring_and_a_damper_the_better_the_smaller_the_steps(damping):
    mass, speed = 2.0, 0.5
    due = spring_and_damper(mass, speed, 2e4, damping)
    off = []
    for substeps in (4, 16, 64):
        body = touching(
            guided("z", [mass]),
            floor("z_slide", stiffness_n_m=2e4, damping_n_s_m=damping),
            substeps=substeps,
        )
        body.dq[0] = -speed
        h, depth, ticks = T / substeps, 0.0, 0
        while body.q[0] == 0.0 or force(body)[2] > 0.0:
            body.step(np.zeros(1), h * substeps)
            depth, ticks = max(depth, -body.q[0]), ticks + 1
        found = np.array([depth, body.dq[0]])
        assert ticks * T == pytest.approx(due[1], abs=2 * T)
        off.append(np.abs(found / [due[0], due[2]] - 1.0))
    assert np.all(off[0] < 0.05)
    assert np.all(off[2] < 0.006)
    assert np.all(off[2] < 0.5 * off[0])


def test_the_wrench_holds_the_whole_impulse_of_an_impact():
    body = touching(guided("z", [2.0]), floor("z_slide", **BOUNCY))
    body.q[0], body.dq[0] = 0.0107, -0.5
    impulse = 0.0
    for _ in range(200):
        body.step(np.zeros(1), T)
        impulse += T * body.wrench[2]
    assert body.dq[0] > 0.3
    assert impulse == pytest.approx(2.0 * (body.dq[0] + 0.5), rel=1e-12)


@given(
    normal=directions,
    speed=directions,
    masses=st.tuples(*[logarithmic(1e-3, 10.0)] * 3),
    stiffness=logarithmic(1e3, 1e7),
    damping=st.one_of(st.just(0.0), logarithmic(1.0, 1e5), st.none()),
    friction=st.sampled_from([0.0, 0.3, 1.0]),
    substeps=st.sampled_from([1, 4]),
)
def test_nothing_leaves_faster_than_it_came_however_light_and_stiff(
    normal, speed, masses, stiffness, damping, friction, substeps
):
    """And no plane ever pulls, acts from outside, or rubs beyond the cone or along the motion."""
    law = {"stiffness_n_m": stiffness, "damping_n_s_m": damping, "friction": friction}
    plane = {"frame": "z_slide", "point_m": (0.0, 0.0, 0.0), "normal": normal, **law}
    description = guided("xyz", masses)
    body = touching(description, plane, substeps=substeps)
    n = np.array(normal) / np.linalg.norm(normal)
    body.dq[:] = speed
    inertia = np.cumsum(masses[::-1])[::-1]
    before = 0.5 * inertia @ body.dq**2
    h = T / substeps
    one = touching(description, plane, substeps=1)
    one.dq[:] = speed
    for _ in range(300):
        depth = -one.q @ n
        one.step(np.zeros(3), h)
        f = force(one)
        pressed = f @ n
        rubbed, slid = f - pressed * n, one.dq - one.dq @ n * n
        scale = 1e-9 * (1.0 + np.linalg.norm(f))
        assert pressed >= -scale
        assert depth > 0.0 or not f.any()
        assert np.linalg.norm(rubbed) <= friction * pressed + scale
        assert rubbed @ slid <= scale
        if np.linalg.norm(slid) > 2 * CREEP:
            assert np.linalg.norm(rubbed) == pytest.approx(friction * pressed, abs=scale, rel=1e-6)
    for _ in range(300):
        body.step(np.zeros(3), T)
    energy = 0.5 * inertia @ body.dq**2
    assert energy <= before * (1.0 + 1e-9)


CONTACTS = (
    {"frame": "ee", "offset_m": (0.03, -0.02, 0.05), "normal": (0.2, -0.3, 2.0)},
    {"frame": "link_6", "offset_m": (0.0, 0.01, 0.0), "normal": (-1.0, 0.4, 0.1)},
    {"frame": "link_2", "offset_m": (0.0, 0.05, 0.1), "normal": (0.0, 1.0, 0.5)},
)
DEPTHS = (2e-3, 1e-3, 3e-3)


def pressed_arm(gravity: str = "none", **law: float):
    """An arm at its initial posture with three points inside planes, and Pinocchio's view of it."""
    description = arm(gravity)
    robot = build_model(description)
    q = np.zeros(7)
    q[robot.order] = description.initial_position
    pin.framesForwardKinematics(robot.model, robot.data, q)
    contacts, forces = [], []
    for each, depth in zip(CONTACTS, DEPTHS, strict=True):
        normal = np.array(each["normal"]) / np.linalg.norm(each["normal"])
        point = robot.data.oMf[robot.frame_id(each["frame"])].act(np.array(each["offset_m"]))
        contacts.append({**each, "point_m": tuple(point + depth * normal), **law})
        forces.append((each["frame"], point, 2e4 * depth * normal))
    return description, contacts, robot, q, forces


def test_wrenches_are_those_of_pinocchios_spatial_forces():
    description, contacts, robot, _, forces = pressed_arm()
    body = touching(description, *contacts)
    felt = {"ee": ("ee",), "link_4": ("ee", "link_6"), "base": ("ee", "link_6", "link_2")}
    for number, sensor in enumerate(description.wrench_sensors):
        whole = pin.Force.Zero()
        for frame, point, f in forces:
            if frame in felt[sensor]:
                whole += pin.SE3(np.eye(3), point).act(pin.Force(f, np.zeros(3)))
        due = robot.data.oMf[robot.frame_id(sensor)].actInv(whole).vector
        np.testing.assert_allclose(body.wrench[6 * number : 6 * number + 6], due, atol=1e-9)


@pytest.mark.parametrize("gravity", ["none", "full"])
def test_what_brakes_carry_is_weight_less_the_torques_of_the_contacts_and_holds_it(gravity):
    """Action and reaction: a static push by the motors is the planes' push back."""
    description, contacts, robot, q, forces = pressed_arm(gravity)
    body = touching(description, *contacts)
    due = np.zeros(7)
    if gravity == "full":
        due += pin.computeGeneralizedGravity(robot.model, robot.data, q)
    for frame, point, f in forces:
        J = pin.computeFrameJacobian(
            robot.model, robot.data, q, robot.frame_id(frame), pin.ReferenceFrame.WORLD
        )
        due -= J.T @ pin.SE3(np.eye(3), point).act(pin.Force(f, np.zeros(3))).vector
    np.testing.assert_allclose(body.tau, due[robot.order], atol=1e-9)
    carried = body.tau.copy()
    for _ in range(200):
        body.step(carried, T)
    np.testing.assert_allclose(body.q, description.initial_position, atol=1e-9)


def test_a_step_is_pinocchios_forward_dynamics_under_the_forces_that_answer_its_velocity():
    description, contacts, robot, _, _ = pressed_arm(friction=0.5)
    rng = np.random.default_rng(1)
    for stiffness in (2e4, 1e6):
        only = {**contacts[0], "stiffness_n_m": stiffness, "damping_n_s_m": 50.0}
        body = touching(description, only, substeps=1)
        order, frame = robot.order, robot.frame_id("ee")
        for _ in range(20):
            body.reset(description.initial_position)
            body.dq[:] = 0.1 * rng.uniform(-1, 1, 7)
            q, dq, tau = np.zeros((3, 7))
            pushed = rng.uniform(-5, 5, 7)
            q[order], dq[order], tau[order] = body.q, body.dq, pushed
            body.step(pushed, T)
            model, data = robot.model, robot.data
            pin.framesForwardKinematics(model, data, q)
            point = data.oMf[frame].act(np.array(only["offset_m"]))
            J = pin.computeFrameJacobian(model, data, q, frame, pin.ReferenceFrame.WORLD)
            jacobian = J[:3] - pin.skew(point) @ J[3:]
            f = force(body)
            model.gravity.setZero()
            ddq = pin.aba(model, data, q, dq, tau + jacobian.T @ f)
            after = dq + T * ddq
            np.testing.assert_allclose(body.dq, after[order], atol=1e-10)
            n = np.array(only["normal"]) / np.linalg.norm(only["normal"])
            v = jacobian @ after
            slid, damping = v - v @ n * n, max(50.0, T * stiffness)
            pressed = max(0.0, stiffness * DEPTHS[0] - damping * (v @ n))
            due = pressed * n - 0.5 * pressed * slid / max(np.linalg.norm(slid), CREEP)
            np.testing.assert_allclose(f, due, rtol=1e-7, atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1))
def test_accelerations_and_torques_undo_each_other_in_contact(seed):
    description = PRESSED[0]
    rng = np.random.default_rng(seed)
    BODY.q[:] = description.initial_position
    BODY.dq[:] = rng.uniform(-0.2, 0.2, 7)
    wanted, torques, found = rng.uniform(-20, 20, 7), np.zeros(7), np.zeros(7)
    BODY.torques(wanted, T, torques)
    BODY.accelerations(torques, T, found)
    np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-6)


PRESSED = pressed_arm(friction=0.6)
BODY = touching(
    PRESSED[0].model_copy(
        update={"joints": tuple(j.model_copy(update={"effort": 1e6}) for j in PRESSED[0].joints)}
    ),
    *PRESSED[1],
)


def test_a_robot_that_touches_nothing_moves_as_one_without_planes():
    free, near = touching(arm("full")), touching(arm("full"), floor("ee"), floor("link_4"))
    for _ in range(50):
        free.step(np.full(7, 0.5), T)
        near.step(np.full(7, 0.5), T)
    np.testing.assert_array_equal(near.q, free.q)
    assert not near.wrench.any()


def test_many_planes_at_once_give_nothing_more_back_than_they_took():
    """Wedges, corners and several points, with light and heavy slides, stiff and soft."""
    rng = np.random.default_rng(4)
    touched = 0
    for _ in range(150):
        masses = 10.0 ** rng.uniform(-3.0, 1.0, 3)
        planes = [
            {
                "frame": str(rng.choice(["y_slide", "z_slide"])),
                "point_m": tuple(-rng.uniform(0.0, 0.01) * normal),
                "normal": tuple(normal),
                "stiffness_n_m": 10.0 ** rng.uniform(3.0, 7.0),
                "damping_n_s_m": rng.choice([0.0, 1e2, 1e5]),
                "friction": rng.choice([0.0, 0.5, 2.0]),
            }
            for normal in rng.normal(size=(rng.integers(2, 5), 3))
        ]
        for plane in planes:  # the start is outside of each
            plane["point_m"] = tuple(np.array(plane["point_m"]) / np.linalg.norm(plane["normal"]))
        body = touching(guided("xyz", masses), *planes, substeps=int(rng.choice([1, 4])))
        body.dq[:] = rng.normal(size=3)
        inertia = np.cumsum(masses[::-1])[::-1]
        before = 0.5 * inertia @ body.dq**2
        for _ in range(100):
            body.step(np.zeros(3), T)
            touched += bool(body.wrench.any())
        assert 0.5 * inertia @ body.dq**2 <= before * (1.0 + 1e-9)
    assert touched > 500
