"""Constraints of a config: found by name, checked, stacked."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest
from support.constraint_bench import PERIOD, Bench, entry, hoap3, small
from support.log_samples import describe

from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError, UnknownNameError
from hoap3.protocol.messages import State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.constraints.constraint import Constraint
from hoap3.remote_controller.constraints.joints.joint_position import JointPosition
from hoap3.remote_controller.constraints.registry import (
    BUILTIN,
    ConstraintSettings,
    build,
    find,
    read,
    registered,
)
from hoap3.remote_controller.constraints.stack import ConstraintStack
from hoap3.remote_controller.model.kinematics import Kinematics

ALL = [
    {"constraint": "joint_position"},
    {"constraint": "support_polygon"},
    {"constraint": "fixed_frame", "frame": "l_sole", "axes": ["x", "y"]},
    {"constraint": "zmp", "name": "walk"},
    {"constraint": "pfaffian", "matrix": [[1.0] * 21]},
    {"constraint": "half_space", "frame": "head", "normal": [0, 0, 1], "offset_m": 0.1},
    {"constraint": "half_space", "frame": "neck", "normal": [0, 0, 1], "offset_m": 0.1},
    {"constraint": "joint_velocity", "limit_rad_s": 0.5},
    {"constraint": "minimum_speed", "joints": {"waist_pitch": 1.0}, "speed": 0.1},
    {"constraint": "distance", "rows": 9, "pairs": [["r_forearm", "l_forearm"]]},
]


class Sloppy(Constraint):
    """A user's own that fails for any robot."""

    def __init__(self, *given: object) -> None:
        raise ZeroDivisionError("none of these")


class Own(Constraint):
    """A user's own."""

    class Parameters(Constraint.Parameters):
        level: float = 1.0

    kinds: ClassVar[list[str]] = []

    def bounds(self, state, lower_out, upper_out):
        np.minimum(upper_out, self.parameters.level, out=upper_out)


def test_every_kind_has_settings_that_refuse_unknown_keys():
    assert set(registered()) >= set(BUILTIN)
    needed = {"half_space": ALL[5], "fixed_frame": ALL[2], "minimum_speed": ALL[8]}
    for name in BUILTIN:
        with pytest.raises(ConfigError, match=r"constraints\.0\.parameters\.speling: "):
            read([entry({"constraint": name, **needed.get(name, {}), "speling": 1})])


def test_rows_names_and_arrays_agree():
    bench = Bench(hoap3(), *ALL)
    stack = bench.stack
    assert stack.A.shape == (len(stack.names), 21) == (4 + 4 + 1 + 1 + 1 + 9, 21)
    assert stack.C.shape == (len(stack.equality_names), 21) == (3, 21)
    assert stack.b.shape == (20,)
    assert stack.names[4] == "walk: edge 0"
    assert stack.names[8:11] == (
        "half_space: head",
        "half_space 2: neck",
        "minimum_speed: waist_pitch",
    )
    assert stack.equality_names[2] == "pfaffian: row 0"
    assert np.isfinite(stack.A).all()
    assert not np.isnan(stack.b).any()
    assert (stack.lower <= stack.upper).all()
    u = bench.nearest(np.full(21, 0.2))
    assert (stack.A @ u <= stack.b + 1e-6).all()
    np.testing.assert_allclose(stack.C @ u, stack.c, atol=1e-6)


def test_each_writes_its_own_rows_only():
    """Every entry alone gives what it gives in the stack."""
    together, rows, equalities = Bench(hoap3(), *ALL).stack, 0, 0
    for each in ALL:
        alone = Bench(hoap3(), each).stack
        count = len(alone.b)
        np.testing.assert_array_equal(together.A[rows : rows + count], alone.A)
        np.testing.assert_array_equal(together.b[rows : rows + count], alone.b)
        np.testing.assert_array_equal(together.C[equalities : equalities + len(alone.c)], alone.C)
        rows, equalities = rows + count, equalities + len(alone.c)
    assert (rows, equalities) == (20, 3)


def test_the_smallest_margin_and_whose_it_is():
    bench = Bench(hoap3(), *ALL)
    least = min(constraint.margin() for constraint in bench.stack.constraints)
    assert bench.stack.margin() == least
    q = bench.robot.initial_position.copy()
    q[3], q[20] = bench.robot.upper[3] - 1e-6, 0.1  # knee, waist
    bench = Bench(hoap3(), ALL[0], ALL[9]).at(q)
    assert bench.stack.margin() == pytest.approx(1e-6)
    assert bench.stack.tightest() == "joint_position: r_knee upper"
    assert bench.stack.tightest_with_unit()[1] == "rad"


@pytest.mark.parametrize("kind", ["joint_position", "viability"])
def test_a_margin_has_the_unit_of_its_joint(kind):
    text = describe(2).to_json().replace(b"revolute", b"prismatic", 1)
    bench = Bench(RobotDescription.from_json(text), {"constraint": kind})
    for joint, unit in ((0, "m"), (1, "rad")):
        for end in (-1.8, 1.8):
            assert bench.at(end * np.eye(2)[joint]).stack.tightest_with_unit()[1] == unit


class Tightened(JointPosition):
    """One's own: what it says last of its margins counts."""

    def bounds(self, state, lower_out, upper_out):
        super().bounds(state, lower_out, upper_out)
        self.margins -= 10.0


class Spoken(Constraint):
    """One that says its margin itself."""

    def margin(self):
        return -1.0


@pytest.mark.parametrize("kind", [Tightened, Spoken])
def test_the_margin_of_ones_own_constraint_is_what_it_says(kind):
    robot = hoap3()
    own = kind(kind.Parameters(), robot, Kinematics(robot), PERIOD)
    stack = ConstraintStack([own], ["mine"], robot.n)
    state = State(robot.n, 0)
    state.q[:] = state.reference[:] = robot.initial_position
    stack.update(Kinematics(robot), state)
    assert stack.margin() == own.margin() < 0.0


def test_only_constraints_with_rows_are_asked_for_rows():
    class Silent(Constraint):
        def update(self, kinematics, state, A_out, b_out):
            raise AssertionError("it has none")

    robot = hoap3()
    kinematics = Kinematics(robot)
    silent = Silent(Silent.Parameters(), robot, kinematics, PERIOD)
    ConstraintStack([silent], ["silent"], robot.n).update(kinematics, State(robot.n, 0))


def test_nothing_at_all_is_a_stack_too():
    stack = Bench(small()).stack
    assert stack.A.shape == (0, 3)
    assert stack.margin() == np.inf
    assert stack.tightest() == ""
    assert np.isneginf(stack.lower).all()


def test_updates_write_into_the_same_arrays():
    bench = Bench(hoap3(), *ALL)
    before = [bench.stack.A, bench.stack.b, bench.stack.C, bench.stack.lower, bench.stack.upper]
    bench.at(bench.robot.initial_position + 0.01)
    after = [bench.stack.A, bench.stack.b, bench.stack.C, bench.stack.lower, bench.stack.upper]
    assert all(one is other for one, other in zip(before, after, strict=True))


def test_the_same_states_give_the_same_bits():
    first, second = Bench(hoap3(), *ALL), Bench(hoap3(), *ALL)
    rng = np.random.default_rng(4)
    for _ in range(20):
        q = hoap3().initial_position + 0.05 * rng.normal(size=21)
        for bench in (first, second):
            bench.at(q)
        for name in ("A", "b", "C", "c", "lower", "upper"):
            one, other = getattr(first.stack, name), getattr(second.stack, name)
            assert one.tobytes() == other.tobytes()


def test_a_users_own_class_is_found_by_dotted_path():
    bench = Bench(small(), {"constraint": f"{__name__}:Own", "level": 0.25, "name": "mine"})
    np.testing.assert_array_equal(bench.stack.upper, 0.25)
    assert find(f"{__name__}:Own") is Own


@pytest.mark.parametrize(
    ("entries", "error", "words"),
    [
        ([{"constraint": "zpm"}], UnknownNameError, "'zmp'"),
        ([{"constraint": "json:loads"}], ConfigError, "json:loads"),
        ([{"constraint": "nowhere:Thing"}], ConfigError, "nowhere:Thing"),
        ([{"constraint": f"{__name__}:Sloppy"}], ConfigError, "ZeroDivisionError: none of these"),
        ([ALL[0], {**ALL[1], "name": "joint_position"}], ConfigError, r"1\.name: "),
        (
            [ALL[0], {**ALL[5], "frame": "nose"}],
            ConfigError,
            r"mine\.yaml: rules\.1\.parameters\.frame",
        ),
    ],
)
def test_wrong_entries_are_named(entries, error, words):
    kinematics = Kinematics(hoap3())
    with pytest.raises(error, match=words):
        build([entry(each) for each in entries], hoap3(), kinematics, PERIOD, "mine.yaml", "rules")


@pytest.mark.parametrize(
    "given", [{}, {"constraint": "zmp", "name": ""}, {"constraint": "zmp", "eta_per_s": 1.0}]
)
def test_an_entry_has_a_constraint_maybe_a_name_and_parameters(given):
    with pytest.raises(ConfigError):
        parse(ConstraintSettings, given, "mine.yaml")
