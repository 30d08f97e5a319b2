"""How far the default task moves the tip: 5 % of the chain's reach, at least 1 cm, and printed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hoap3.robot_emulator.robots.urdf_import.imported import ImportedRobot, import_robot

LEAST_M, SHARE = 0.01, 0.05


def chain(folder: Path, joints: list[tuple[str, str, float, float, float]]) -> ImportedRobot:
    """Import a chain: of each joint its kind, axis, limits, and distance to the one before it."""
    text = ['<robot name="chain"><link name="l0"/>']
    for i, (kind, axis, lower, upper, length) in enumerate(joints):
        text.append(
            f'<link name="l{i + 1}"/><joint name="j{i}" type="{kind}"><parent link="l{i}"/>'
            f'<child link="l{i + 1}"/><origin xyz="{length} 0 0"/><axis xyz="{axis}"/>'
            f'<limit lower="{lower}" upper="{upper}" velocity="1" effort="1"/></joint>'
        )
    path = folder / "chain.urdf"
    path.write_text("".join([*text, "</robot>"]), encoding="utf-8")
    return import_robot(path)


def turns(*lengths: float) -> list[tuple[str, str, float, float, float]]:
    return [("revolute", "0 0 1" if i % 2 else "0 1 0", -2, 2, x) for i, x in enumerate(lengths)]


@pytest.mark.parametrize(
    ("joints", "reach"),
    [
        (turns(0.0, 0.02, 0.015, 0.01), 0.045),  # a finger: 5 % of it is 2 mm
        (turns(0.3, 0.4, 0.4, 0.2), 1.0),
        (turns(1.0, 2.0, 3.0, 1.0), 6.0),
        ([("prismatic", "1 0 0", 0.0, 0.5, 0.0)], 0.5),
        ([("prismatic", axis, -1.0, 1.0, 0.0) for axis in ("1 0 0", "0 1 0", "0 0 1")], 6.0),
        ([("prismatic", "0 0 1", 0.0, 0.4, 0.0), *turns(0.3, 0.3)], 1.0),
    ],
)
def test_a_chain_moves_by_a_share_of_its_reach(joints, reach, tmp_path):
    robot = chain(tmp_path, joints)
    moved = float(np.linalg.norm(robot.file.default_task.move_m))
    assert max(LEAST_M, SHARE * reach) <= moved <= 1.5 * max(LEAST_M, SHARE * reach)
    (note,) = [str(note) for note in robot.notes if "default task" in str(note)]
    assert f"{moved:.3g} m" in note
    assert f"{moved / reach:.1%}" in note


def test_where_ranges_are_too_narrow_it_moves_as_far_as_they_permit(tmp_path):
    narrow = ("revolute", "0 0 1", -0.02, 0.02, 0.0)
    robot = chain(tmp_path, [narrow, ("revolute", "1 0 0", -1.0, 1.0, 0.3)])
    moved = float(np.linalg.norm(robot.file.default_task.move_m))
    assert moved == pytest.approx(0.3 * 0.01, rel=0.01)  # half of the way to the limit
