"""What a page is shown: shapes, places of links, contacts and figures of a State."""

from __future__ import annotations

import hashlib
import json
import math
import struct
import warnings
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest
from view_samples import UR5, posed

import hoap3
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.constraints.collision.collision_geometry import rotation as rotation_of
from hoap3.tools.view.picture.changeable import sliders
from hoap3.tools.view.picture.contacts import Contacts
from hoap3.tools.view.picture.frame import Frames, shares_of_limits
from hoap3.tools.view.picture.geometry import looks_of, primitives, quaternion

ROBOTS = ("hoap3", "ur5", "lwr", "baxter_left_arm", "humanoid32")
HOAP3 = hoap3.load_robot("hoap3")


def plain(robot: RobotDescription, q: np.ndarray) -> tuple[pin.Model, pin.Data]:
    """The model of its URDF at q, which is in wire order, by joint names alone."""
    model = pin.buildModelFromXML(robot.urdf)
    data, ours = model.createData(), np.zeros(model.nq)
    for name, angle in zip(robot.joint_names, q, strict=True):
        ours[model.joints[model.getJointId(name)].idx_q] = angle
    pin.framesForwardKinematics(model, data, ours)
    pin.centerOfMass(model, data, ours)
    return model, data


def some_q(robot: RobotDescription, seed: int = 3) -> np.ndarray:
    lower, upper = robot.sampling_range
    return np.random.default_rng(seed).uniform(lower, upper)


def placed(model: pin.Model, data: pin.Data, link: str) -> pin.SE3:
    return data.oMf[model.getFrameId(link, pin.FrameType.BODY)]


@pytest.mark.parametrize("name", ROBOTS)
def test_a_fixed_robot_stands_with_its_base_frame_at_the_origin(name):
    robot = hoap3.load_robot(name)
    q = some_q(robot)
    model, data = plain(robot, q)
    poses = posed(robot, q)
    base = placed(model, data, robot.base_frame)
    for link, pose in zip(poses.links, poses.poses, strict=True):
        expected = base.actInv(placed(model, data, link))
        assert np.allclose(pin.XYZQUATToSE3(np.array(pose)).homogeneous, expected.homogeneous)
    assert np.allclose(poses.pose(robot.base_frame), [0, 0, 0, 0, 0, 0, 1])


def test_a_free_base_is_where_its_state_says():
    robot = HOAP3
    q = some_q(robot)
    base = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.2, 1.1), np.array([0.4, -0.7, 0.35]))
    told = np.zeros(13)
    told[:7] = pin.SE3ToXYZQUAT(base)
    model, data = plain(robot, q)
    poses = posed(robot, q, told)
    for link in ("pelvis", "l_sole", "r_sole"):
        expected = base * placed(model, data, link)
        found = pin.XYZQUATToSE3(np.array(poses.pose(link)))
        assert np.allclose(found.homogeneous, expected.homogeneous)


def test_the_centre_of_mass_is_that_of_all_links():
    robot = HOAP3
    q = some_q(robot)
    base = np.r_[0.1, 0.2, 0.3, np.array([0.1, -0.3, 0.2, 0.9]) / np.sqrt(0.95), np.zeros(6)]
    poses = posed(robot, q, base)
    model, data = plain(robot, q)
    masses = [each.mass for each in model.inertias]  # joint 0 is the root link
    places = [data.oMi[i].act(each.lever) for i, each in enumerate(model.inertias)]
    com = np.average(places, axis=0, weights=masses)
    assert np.allclose(poses.com, pin.XYZQUATToSE3(base[:7]).act(com), atol=1e-12)
    seen = placed(model, data, "r_sole").actInv(com)
    assert np.allclose(poses.com_from("r_sole"), seen, atol=1e-12)


def test_a_link_is_seen_from_another():
    q = some_q(UR5)
    model, data = plain(UR5, q)
    expected = placed(model, data, "base").actInv(placed(model, data, "tool0"))
    found = pin.XYZQUATToSE3(np.array(posed(UR5, q).seen_from("tool0", "base")))
    assert np.allclose(found.homogeneous, expected.homogeneous)


URDF = """<robot name="one">
<material name="blue"><color rgba="0 0 1 1"/></material>
<link name="base"><visual><origin xyz="0.1 0.2 0.3" rpy="0 0 1.5707963267948966"/>
<geometry><cylinder radius="0.05" length="0.4"/></geometry><material name="blue"/></visual></link>
<link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="0.1 0.2 0.3"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def stl(path: Path) -> None:
    """A tetrahedron as binary STL."""
    body = b"".join(struct.pack("<12fH", *np.zeros(3), *CORNERS[face].ravel(), 0) for face in FACES)
    path.write_bytes(bytes(80) + struct.pack("<I", len(FACES)) + body)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "meshes").mkdir()
    stl(tmp_path / "meshes" / "arm.stl")
    digest = hashlib.sha256((tmp_path / "meshes" / "arm.stl").read_bytes()).hexdigest()
    (tmp_path / "one.urdf").write_text(URDF)
    (tmp_path / "robot.yaml").write_text(
        f"name: one\nurdf: one.urdf\nmeshes:\n  - {{link: arm, file: arm.stl, sha256: {digest}, "
        "scale: [2.0, 1.0, 1.0], xyz_m: [0.0, 0.0, 0.5]}\n"
    )
    return tmp_path


def test_primitives_are_those_of_the_description(folder):
    shapes = primitives(hoap3.load_robot(folder))
    (cylinder,), (box,) = shapes["base"], shapes["arm"]
    assert (cylinder["shape"], cylinder["size"]) == ("cylinder", [0.05, 0.4])
    assert cylinder["color"] == [0, 0, 1, 1]
    half = np.sqrt(0.5)
    assert np.allclose(cylinder["origin"], [0.1, 0.2, 0.3, 0, 0, half, half])
    assert (box["shape"], box["size"]) == ("box", [0.1, 0.2, 0.3])


@pytest.mark.parametrize("name", ["hoap3", "ur5", "humanoid32"])
def test_every_visual_of_a_shipped_robot_is_drawn(name):
    robot = hoap3.load_robot(name)
    drawn = primitives(robot)
    assert set(drawn) == set(robot.frames)
    written = len(list(ET.fromstring(robot.urdf).iter("visual")))
    assert sum(map(len, drawn.values())) == written > 0


def test_a_mesh_of_the_folder_is_drawn_and_packed(folder):
    looks = looks_of(hoap3.load_robot(folder), str(folder))
    (shape,) = looks.visuals["arm"]
    assert (shape["shape"], shape["size"]) == ("mesh", [2.0, 1.0, 1.0])
    assert shape["origin"] == [0, 0, 0.5, 0, 0, 0, 1]
    raw = looks.meshes[shape["mesh"].removeprefix("/mesh/")]
    n, m = struct.unpack_from("<II", raw)
    vertices = np.frombuffer(raw, "<f4", 3 * n, 8).reshape(n, 3)
    triangles = np.frombuffer(raw, "<u4", 3 * m, 8 + 12 * n).reshape(m, 3)
    assert len(raw) == 8 + 12 * (n + m)
    found = {frozenset(map(tuple, vertices[each].tolist())) for each in triangles}
    assert found == {frozenset(map(tuple, CORNERS[face].tolist())) for face in FACES}
    assert looks.visuals["base"][0]["shape"] == "cylinder"


def test_a_mesh_that_is_another_one_or_of_another_robot_is_not_drawn(folder):
    path = folder / "meshes" / "arm.stl"
    path.write_bytes(path.read_bytes() + b"\0")
    looks = looks_of(hoap3.load_robot(folder), str(folder))
    assert looks.visuals["arm"][0]["shape"] == "box"
    for each in (looks, looks_of(UR5, str(folder))):
        assert not each.meshes
        assert len(each.notes) == 1


def test_quaternions_turn_as_their_matrices():
    rng = np.random.default_rng(5)
    for rpy in rng.uniform(-np.pi, np.pi, (50, 3)):
        rotation = rotation_of(*rpy)
        x, y, z, w = quaternion(rotation)
        v = np.array([x, y, z])
        for axis in np.eye(3):
            turned = axis + 2 * w * np.cross(v, axis) + 2 * np.cross(v, np.cross(v, axis))
            assert np.allclose(turned, rotation @ axis, atol=1e-12)


ARRAYS = {"base": 13, "contact": 12}


@pytest.fixture(scope="module")
def robot():
    return HOAP3.model_copy(update={"state_arrays": ARRAYS})


@pytest.fixture
def standing(robot):
    """A State on both soles, tilted a little, and its kinematics."""
    state = State.allocate(**robot.state_lengths)
    state.q[:] = robot.initial_position
    base = pin.SE3(pin.rpy.rpyToMatrix(0.05, -0.03, 0.4), np.array([0.3, -0.2, 0.3]))
    state.base[:7] = pin.SE3ToXYZQUAT(base)
    return state, posed(robot, state.q, state.base)


def test_a_force_acts_at_the_centre_of_pressure(robot, standing):
    state, poses = standing
    at, force = np.array([0.02, -0.01, 0.0]), np.array([3.0, -2.0, 60.0])
    state.contact[:3], state.contact[3:6] = force, np.cross(at, force)
    (found,) = Contacts(robot, None).look(state, poses)["contacts"]
    sole = poses.placement(robot.soles[0].frame)
    assert np.allclose(found["at"], sole.act(at), atol=1e-6)
    assert np.allclose(found["force"], sole.rotation @ force, atol=1e-4)


def test_about_the_zero_moment_point_the_ground_has_no_torque_about_level_axes(robot, standing):
    state, poses = standing
    state.contact[:] = [3.0, -2.0, 40.0, 0.3, -0.5, 0.1, -1.0, 4.0, 25.0, -0.2, 0.4, 0.0]
    zmp = Contacts(robot, None).look(state, poses)["zmp"]
    soles = [poses.placement(sole.frame) for sole in robot.soles]
    forces = [sole.rotation @ state.contact[6 * i : 6 * i + 3] for i, sole in enumerate(soles)]
    up = [force[2] for force in forces]
    height = np.average([sole.translation[2] for sole in soles], weights=up)
    moment = np.zeros(3)
    for i, (sole, force) in enumerate(zip(soles, forces, strict=True)):
        moment += sole.rotation @ state.contact[6 * i + 3 : 6 * i + 6]
        moment += np.cross(sole.translation - [*zmp, height], force)
    assert np.allclose(moment[:2], 0.0, atol=1e-3)  # N m: of a place that is rounded to 1 µm


def test_the_polygon_is_around_the_soles_that_bear(robot, standing):
    state, poses = standing
    state.contact[2] = 50.0
    one = Contacts(robot, None).look(state, poses)["polygon"]
    assert len(one) == 4
    state.contact[8] = 50.0
    both = np.array(Contacts(robot, None).look(state, poses)["polygon"])
    edges = np.roll(both, -1, axis=0) - both
    for sole in robot.soles:
        for x, y in sole.polygon:
            away = poses.placement(sole.frame).act(np.array([x, y, 0.0]))[:2] - both
            out = edges[:, 0] * away[:, 1] - edges[:, 1] * away[:, 0]
            assert (out > -1e-8).all()  # left of each edge: inside
    assert len(both) >= 6


def test_in_the_air_there_is_neither(robot, standing):
    state, poses = standing
    found = Contacts(robot, None).look(state, poses)
    assert found == {"contacts": [], "zmp": None, "polygon": None}


def test_without_forces_those_soles_count_that_are_said_to_stand():
    robot = HOAP3
    state = State.allocate(**robot.state_lengths)
    poses = posed(robot, robot.initial_position)
    found = Contacts(robot, None, ["r_sole"]).look(state, poses)
    expected = next(sole for sole in robot.soles if sole.frame == "r_sole").polygon
    assert {tuple(each) for each in np.round(found["polygon"], 9)} == set(expected)


def test_a_wrench_sensor_shows_what_it_feels():
    robot = hoap3.load_robot("lwr")
    state = State.allocate(**robot.state_lengths)
    state.wrench[:3] = [0.0, 2.0, 5.0]
    poses = posed(robot, robot.initial_position)
    (found,) = Contacts(robot, None).look(state, poses)["contacts"]
    tool = poses.placement("ee")
    assert np.allclose(found["at"], tool.translation, atol=1e-6)
    assert np.allclose(found["force"], tool.rotation @ [0.0, 2.0, 5.0], atol=1e-4)


def test_forces_of_links_that_the_emulator_names(standing):
    robot = HOAP3.model_copy(update={"state_arrays": {"base": 13, "contact": 6}})
    _, poses = standing
    state = State.allocate(**robot.state_lengths)
    state.contact[:3] = [0.0, 0.0, 9.0]
    assert not Contacts(robot, None).look(state, poses)["contacts"]  # one of two soles: which?
    emulator = {"plant": {"parameters": {"contact_frames": ["pelvis"]}}}
    (found,) = Contacts(robot, emulator).look(state, poses)["contacts"]
    assert np.allclose(found["at"], poses.placement("pelvis").translation, atol=1e-6)


@pytest.fixture
def hoap3_frames() -> Frames:
    return Frames(HOAP3, looks_of(HOAP3), {"extra": ["gamma"]})


@pytest.fixture
def state() -> State:
    made = State.allocate(**HOAP3.state_lengths)
    made.q[:] = HOAP3.initial_position
    made.tick, made.stamp_published, made.mode = 2_345, 987_654_321, State.ACTIVE
    made.late, made.lost, made.skipped, made.success_rate = 3, 4, 5, 0.93
    return made


def answer(state: State, extra: float = 0.0) -> Setpoint:
    made = Setpoint(HOAP3.n, 1)
    made.tick = state.tick
    made.v, made.v_rate_required, made.rho, made.margin = 0.02, -0.4, 1.0, 1e-3
    made.active_joints, made.extra[0] = 6, extra
    made.stamp_received, made.stamp_encoded = 1_000_000, 1_150_000
    return made


def test_a_frame_is_of_its_state(hoap3_frames, state):
    found = hoap3_frames.frame(state, answer(state, 0.5))
    assert (found["tick"], found["time_s"], found["stamp_ns"]) == (2345, 2.345, 987_654_321)
    assert found["mode"] == "active"
    poses = posed(HOAP3, state.q)
    assert np.allclose(found["poses"], poses.poses, atol=1e-6)
    assert np.allclose(found["com"], poses.com, atol=1e-6)
    assert len(found["polygon"]) == 4  # the right sole, which the robot stands on
    values = found["values"]
    assert values["error"] == pytest.approx(math.sqrt(0.04))
    assert (values["v"], values["v_rate_required"], values["margin"]) == (0.02, -0.4, 1e-3)
    assert (values["misses"], values["skipped"], values["success_rate"]) == (7, 5, 0.93)
    assert (values["active_joints"], values["cycle_us"], values["extra.0"]) == (6, 150.0, 0.5)


def test_all_of_it_is_json_and_every_value_is_one_that_is_plotted(hoap3_frames, state):
    keys = {plot["key"] for plot in hoap3_frames.plots()}
    found = hoap3_frames.frame(state, answer(state))
    assert found["values"].keys() <= keys
    assert "extra.0" in keys
    for content in (hoap3_frames.hello(), found):
        assert json.loads(json.dumps(content, allow_nan=False)) == content


def test_what_is_not_known_is_none(hoap3_frames, state):
    silent = hoap3_frames.frame(state, None)["values"]
    assert "v" not in silent
    setpoint = answer(state, math.nan)
    setpoint.v = math.inf
    found = hoap3_frames.frame(state, setpoint)["values"]
    assert found["v"] is found["extra.0"] is found["error"] is None
    setpoint.solver_status = Setpoint.schema.constants["STATUS_NONE"]
    assert "margin" not in hoap3_frames.frame(state, setpoint)["values"]


def test_the_speed_of_a_joint_is_judged_by_its_limit(hoap3_frames, state):
    state.dq[3] = -0.5 * HOAP3.velocity[3]
    found = hoap3_frames.frame(state, None)["values"]
    assert found["speed_share"] == pytest.approx(50.0)


def test_speeds_and_efforts_that_are_no_numbers_are_not_shown_as_zero(hoap3_frames, state):
    state.dq[3], state.tau[4] = math.nan, math.inf
    found = hoap3_frames.frame(state, None)
    assert found["dq"][3] is found["tau"][4] is None
    assert found["dq"][2] is not None


def test_a_joint_at_its_limit_uses_all_of_its_range(hoap3_frames, state):
    state.q[:] = (HOAP3.lower + HOAP3.upper) / 2.0
    assert hoap3_frames.frame(state, None)["values"]["position_share"] == pytest.approx(0.0)
    state.q[5] = HOAP3.upper[5]
    assert hoap3_frames.frame(state, None)["values"]["position_share"] == pytest.approx(100.0)


def test_a_joint_without_limits_uses_none_of_its_range():
    """Its middle, inf - inf, is not computed: numpy would warn in the user's terminal."""
    lower, upper = HOAP3.lower.copy(), HOAP3.upper.copy()
    lower[2], upper[2] = -np.inf, np.inf
    robot, q = SimpleNamespace(lower=lower, upper=upper, velocity=HOAP3.velocity), HOAP3.upper
    robot.effort, still = HOAP3.effort, np.zeros(len(q))
    with warnings.catch_warnings(action="error"):
        assert shares_of_limits(robot, q, still, still)["position_share"] == pytest.approx(100.0)


def test_sliders_have_the_bounds_that_the_controller_tells():
    now = {"gamma": 0.5, "tasks": {"hand": {"kp": 10.0}}}
    numbers = [
        {"key": "gamma", "meaning": "of the norm", "lower": 0.0, "upper": 1.0},
        {"key": "tasks.hand.kp", "meaning": "of the error [1/s²]", "lower": 0.0, "upper": None},
    ]
    gamma, kp = sliders(now, numbers)
    assert (gamma["key"], gamma["value"], gamma["lower"], gamma["upper"]) == ("gamma", 0.5, 0, 1)
    assert (kp["key"], kp["label"], kp["unit"]) == ("tasks.hand.kp", "of the error", "1/s²")
    words = {"names": ["a"], "alpha": [[0.0]], "on": True, "few": [1.0, 2.0], "none": None}
    assert [each["key"] for each in sliders(words, [])] == ["few", "none"]
    assert sliders(None, None) == sliders("x", 3) == []
    assert sliders(now, None)[0]["lower"] is None
    assert sliders(now, [{"key": []}, {"key": None}, 3, *numbers]) == [gamma, kp]


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
@pytest.mark.parametrize("array", ["q", "base"])
def test_a_state_that_does_not_say_where_it_is_does_not_fit(robot, standing, array, wrong):
    frames, (state, _) = Frames(robot, looks_of(robot)), standing
    assert frames.fits(state)
    getattr(state, array)[2] = wrong
    assert not frames.fits(state)


@pytest.mark.parametrize("array", ["contact", "dq"])
def test_of_a_state_that_says_where_it_is_the_rest_may_be_unknown(robot, standing, array):
    frames, (state, _) = Frames(robot, looks_of(robot)), standing
    state.contact[2] = 30.0
    assert frames.frame(state, None)["zmp"] is not None
    getattr(state, array)[3] = math.nan
    assert frames.fits(state)
    found = frames.frame(state, None)
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert (found["zmp"] is None) == (array == "contact")
    assert (found["values"]["speed_share"] is None) == (array == "dq")
