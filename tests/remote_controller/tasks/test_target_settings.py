"""Bad targets and bad CSV files: one error that names the place, the value and the remedy."""

from __future__ import annotations

import pytest
from task_cases import HOAP3, kinematics_of

from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.tasks.registry import TaskSettings, build

GOOD = "t,x,y,z\n0,0,0,0.3\n1,0.1,0,0.3\n"
CSV = {
    "another header": ("t;x;y;z\n", "line 1"),
    "no header": ("", ""),
    "a column too few": ("t,x,y\n0,0,0\n1,0,0\n", "line 1.*'z'"),
    "velocities": ("t,x,y,z,x/velocity\n0,0,0,0,0\n1,0,0,0,0\n", "line 1"),
    "no number": (GOOD + "2,0.1,zero,0.3\n", "line 4, column y"),
    "not finite": (GOOD + "2,0.1,0,nan\n", "line 4, column z"),
    "a value too few": (GOOD + "2,0.1,0\n", "line 4.*'2,0.1,0'"),
    "time stands": (GOOD + "1,0.1,0,0\n", "line 4, column t"),
    "time before 0": ("t,x,y,z\n-1,0,0,0\n0,0,0,0\n", "line 2, column t"),
    "one row": ("t,x,y,z\n0,0,0,0.3\n", "found 1"),
    "not text": (b"t,x,y,z\n\xff\xfe", "UTF-8"),
}


def build_com(tmp_path, target):
    settings = TaskSettings(task="com", parameters={"target": target})
    file = str(tmp_path / "mine.yaml")
    return build(settings, HOAP3, kinematics_of("hoap3"), file, "v")


@pytest.mark.parametrize("case", CSV)
def test_a_bad_csv(case, tmp_path):
    content, named = CSV[case]
    raw = content if isinstance(content, bytes) else content.encode()
    (tmp_path / "path.csv").write_bytes(raw)
    with pytest.raises(ConfigError, match=rf"path\.csv.*{named}") as caught:
        build_com(tmp_path, {"kind": "spline", "file": "path.csv"})
    assert caught.value.file == str(tmp_path / "path.csv")
    assert caught.value.remedy


def test_a_csv_that_is_not_there(tmp_path):
    with pytest.raises(ConfigError, match=r"nothing\.csv: "):
        build_com(tmp_path, {"kind": "spline", "file": "nothing.csv"})


def test_a_curve_that_repeats_must_be_closed(tmp_path):
    (tmp_path / "path.csv").write_text(GOOD)
    with pytest.raises(ConfigError, match=r"path\.csv"):
        build_com(tmp_path, {"kind": "spline", "file": "path.csv", "repeat": True})


def test_a_good_csv_beside_the_config(tmp_path):
    (tmp_path / "path.csv").write_text("\ufeff" + GOOD + "\n")  # with a mark, as spreadsheets save
    assert build_com(tmp_path, {"kind": "spline", "file": "path.csv"}).target.dimension == 3


POINTS = [[0, 0, 0.3], [0, 0.1, 0.3]]
SETTINGS = [
    ({"kind": "square"}, "square"),
    ({"kind": "point", "position_m": [0, 0, 0.3], "positon_m": 1}, "positon_m"),
    ({"kind": "point", "position_m": [0, 0]}, "position_m"),
    ({"kind": "point", "position_m": [0, 0, float("inf")]}, "position_m.2"),
    ({"kind": "waypoints", "points_m": POINTS}, "times_s"),
    ({"kind": "waypoints", "points_m": POINTS, "times_s": [1]}, "times_s"),
    ({"kind": "waypoints", "points_m": POINTS, "times_s": [2, 1]}, "times_s"),
    ({"kind": "waypoints", "points_m": POINTS, "speed_m_s": 0}, "speed_m_s"),
    (
        {"kind": "circle", "center_m": [0, 0, 0], "radius_m": -1, "period_s": 1},
        "radius_m",
    ),
]


@pytest.mark.parametrize(("target", "key"), SETTINGS)
def test_bad_settings_name_the_key(target, key, tmp_path):
    with pytest.raises(ConfigError, match=key) as caught:
        build_com(tmp_path, target)
    assert str(caught.value).startswith(f"{tmp_path / 'mine.yaml'}: v.parameters.target")
