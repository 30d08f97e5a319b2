"""What pages show of one's own is what `hoap3 new` writes: there is one text of each."""

from __future__ import annotations

import pytest
from pages import blocks

from hoap3.tools.new.package import render


@pytest.mark.parametrize(
    ("kind", "name", "page", "shown"),
    [
        ("controller", "posture", "extending.md", "posture_control.py"),
        ("task", "reach", "extending.md", "reach.py"),
        ("constraint", "least_height", "extending.md", "least_height.py"),
        ("plant", "springs", "plants.md", "springs.py"),
        ("robot", "bench_arm", "robots.md", "bench_arm/bench_arm.urdf"),
    ],
)
def test_a_page_shows_what_is_written(kind, name, page, shown):
    (block,) = [each for each in blocks(page) if (each.word, each.rest) == ("file", shown)]
    assert block.text == render(kind, name)[f"src/{shown.replace('_control', '')}"]


def test_the_robot_that_is_written_has_a_default_task_beside_what_the_page_shows():
    shown = ("file", "bench_arm/robot.yaml")
    (block,) = [each for each in blocks("robots.md") if (each.word, each.rest) == shown]
    text = render("robot", "bench_arm")["src/bench_arm/robot.yaml"]
    assert text.startswith(block.text)
    assert text.removeprefix(block.text).startswith("default_task: ")
