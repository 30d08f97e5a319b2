"""Figures of made-up series, against the same by plain loops over their definitions."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoap3.remote_controller.controllers.base import STATUS
from hoap3.tools.analysis.compare.figures import WORDS, Series, figures, findings, value

pytestmark = pytest.mark.slow

SPEEDS = st.sampled_from([0.0, 1e-3, -1e-3, 0.999e-3, 0.5, -2.0, 0.25])
PLACES = st.integers(-1000, 1000).map(lambda place: place / 999)
VALUES = [0.0, 2.0, 1.0, 2e-4, 1e-4, 1e-9]


def series_of(status, v, rho, margin, unit="rad/s", **columns) -> Series:
    tick, psi = np.arange(len(status)), np.zeros(len(status))
    return Series(tick, columns.pop("time_s"), status, v, psi, rho, margin, columns.pop("inputs"),
                  unit, **columns)  # fmt: skip


@st.composite
def made_up(draw, k=None, n=3):
    k = draw(st.integers(0, 12)) if k is None else k
    period = draw(st.sampled_from([0.001, 0.01]))

    def column(values):
        return np.array(draw(st.lists(values, min_size=k, max_size=k)))

    def rows(values, width):
        size = k * width
        flat = draw(st.lists(values, min_size=size, max_size=size))
        return np.array(flat, float).reshape(k, width)

    status = column(st.sampled_from(sorted(STATUS.values()))).astype(np.int64)
    v, rho, margin = (
        np.where(status == STATUS["none"], np.nan, column(st.sampled_from(values)))
        for values in (VALUES, [1.0, 0.5, 0.0, -2.0], [1.0, 0.0, -1e-7, -1e-3])
    )
    return series_of(
        period_s=period,
        time_s=period * np.arange(k),
        inputs=rows(SPEEDS, n),
        status=status,
        v=v,
        rho=rho,
        margin=margin,
        position=column(st.integers(0, 2)).astype(np.int64),
        speed=column(st.integers(0, 2)).astype(np.int64),
        com_m=rows(PLACES, 3),
        reference=rows(PLACES, n),
    )


def near(found, expected):
    return found == pytest.approx(expected, rel=1e-12, abs=1e-300)


@settings(max_examples=60)
@given(made_up())
def test_control_effort_activity_and_switching(series):
    found = figures(series, series, closed_loop=True)
    k, n = series.inputs.shape
    if not k:
        assert found["control_effort"] == {"l1": None, "l2": None, "max": None}
        assert found["active_joints"] == {"mean": None, "max": None}
        assert found["switching_per_s"] is None
        return
    l1 = l2 = greatest = 0.0
    counts, changes = [], 0
    for tick in range(k):
        count = 0
        for joint in range(n):
            size = abs(series.inputs[tick, joint])
            l1 += size * series.period_s
            l2 += size * size * series.period_s
            greatest = max(greatest, size)
            count += size >= 0.001
            if tick:
                before = abs(series.inputs[tick - 1, joint]) >= 0.001
                changes += (size >= 0.001) != before
        counts.append(count)
    assert near(found["control_effort"]["l1"], l1)
    assert near(found["control_effort"]["l2"], l2)
    assert found["control_effort"]["max"] == greatest
    assert near(found["active_joints"]["mean"], sum(counts) / k)
    assert found["active_joints"]["max"] == max(counts)
    assert near(found["switching_per_s"], changes / (k * series.period_s))


@settings(max_examples=60)
@given(made_up())
def test_error_and_the_time_to_one_per_cent(series):
    found = figures(series, series, closed_loop=True)["error"]
    told = [
        (series.time_s[tick], math.sqrt(2.0 * series.v[tick]))
        for tick in range(len(series))
        if series.status[tick] != STATUS["none"]
    ]
    if not told:
        assert set(found.values()) == {None}
        return
    assert near(found["start"], told[0][1])
    assert near(found["end"], told[-1][1])
    assert near(found["integral"], sum(error for _, error in told) * series.period_s)
    small = [at for at, error in told if error <= 0.01 * told[0][1]]
    assert found["settled_s"] == (small[0] if small else None)


@settings(max_examples=60)
@given(made_up())
def test_paths_are_as_long_as_their_steps(series):
    found = figures(series, series, closed_loop=True)["path"]
    for key, points in (("com_m", series.com_m), ("joints_rad", series.reference)):
        steps = [math.dist(a, b) for a, b in itertools.pairwise(points)]
        assert near(found[key], sum(steps)) if len(points) else found[key] is None


@settings(max_examples=60)
@given(made_up())
def test_certificates_violations_and_findings_are_counted(series):
    found = figures(series, series, closed_loop=True)
    for name, number in STATUS.items():
        assert found["certificates"][name] == list(series.status).count(number)
    told = [tick for tick, each in enumerate(series.status) if each != STATUS["none"]]
    assert found["margin_min"] == min((series.margin[t] for t in told), default=None)
    assert found["rho_min"] == min((series.rho[t] for t in told), default=None)
    violations = {
        "position": sum(each > 0 for each in series.position),
        "speed": sum(each > 0 for each in series.speed),
        "margin": sum(series.margin[t] < -1e-6 for t in told),
    }
    assert found["violations"] == violations
    bad = [found["certificates"][name] for name in ("uncertified", "infeasible")]
    expected = [count for count in (*bad, *violations.values()) if count]
    assert [int(each.split()[1]) for each in findings("x:", found)] == expected


@settings(max_examples=60)
@given(st.integers(1, 8).flatmap(lambda k: st.tuples(made_up(k=k), made_up(k=k))))
def test_differences_are_those_to_the_first(pair):
    first, second = pair
    open_loop = figures(second, first, closed_loop=False)
    assert open_loop["u_difference"] == max(
        abs(a - b) for a, b in zip(second.inputs.ravel(), first.inputs.ravel(), strict=True)
    )
    found = figures(second, first, closed_loop=True)["v_difference"]
    none = STATUS["none"]
    if first.status[0] == none or first.v[0] == 0.0:
        assert found is None
        return
    differences = [
        abs(second.v[tick] - first.v[tick]) / first.v[0]
        for tick in range(len(first))
        if none not in {first.status[tick], second.status[tick]}
    ]
    assert found == max(differences, default=None)


@settings(max_examples=60)
@given(made_up())
def test_an_open_loop_has_nothing_of_what_a_robot_would_have_done(series):
    found = figures(series, series, closed_loop=False)
    for key in ("error.start", "error.end", "error.settled_s", "error.integral", "v_difference"):
        assert value(found, key) is None
    assert found["path"] == {"com_m": None, "joints_rad": None}
    assert found["success_rate"] is None


@settings(max_examples=60)
@given(made_up())
def test_every_word_is_a_figure_and_every_figure_has_its_word(series):
    found = figures(series, series, closed_loop=True)
    keys = set()
    for name, each in found.items():
        keys |= {f"{name}.{inner}" for inner in each} if isinstance(each, dict) else {name}
    details = {
        key for key in keys if key.startswith(("deadlines.", "task.", "limits_and_balance."))
    }
    assert {word.key for word in WORDS} == keys - details - {"unit"}


def test_what_is_no_speed_has_no_active_joints():
    series = series_of(
        period_s=0.001,
        time_s=np.zeros(1),
        inputs=np.ones((1, 2)),
        status=np.zeros(1, np.int64),
        v=np.ones(1),
        rho=np.ones(1),
        margin=np.ones(1),
        position=None,
        speed=None,
        unit="N m",
    )
    found = figures(series, series, closed_loop=True)
    assert found["violations"] == {"position": None, "speed": None, "margin": 0}
    assert findings("it", found) == []
    assert found["active_joints"] == {"mean": None, "max": None}
    assert found["switching_per_s"] is None
    assert found["control_effort"]["max"] == 1.0


def test_a_value_that_is_no_v_is_no_error():
    series = series_of(
        period_s=0.001,
        time_s=np.arange(3) / 1e3,
        inputs=np.zeros((3, 1)),
        status=np.full(3, STATUS["uncertified"]),
        v=np.array([np.nan, -1.0, 2.0]),
        rho=np.array([np.nan, np.inf, 1.0]),
        margin=np.array([np.nan, -np.inf, 1.0]),
        position=np.zeros(3, np.int64),
        speed=np.zeros(3, np.int64),
    )
    found = figures(series, series, closed_loop=True)
    assert found["error"]["start"] == found["error"]["end"] == 2.0
    assert found["rho_min"] == found["margin_min"] == 1.0


@settings(max_examples=30)
@given(made_up(k=4), st.sampled_from(["rad/s²", "N m"]))
def test_forces_are_not_said_to_keep_limits_of_positions_and_speeds(series, unit):
    forces = replace(series, unit=unit, position=None, speed=None)
    found = figures(forces, forces, closed_loop=True)
    assert found["violations"]["position"] is None
    assert found["violations"]["speed"] is None
    assert not any("beyond" in each for each in findings("x:", found))
