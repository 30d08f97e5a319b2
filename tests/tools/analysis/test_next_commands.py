"""The commands that a service prints at its end."""

from __future__ import annotations

from pathlib import Path

import pytest

from hoap3.tools.analysis.summary import show_next_of_service


@pytest.mark.parametrize(
    ("side", "commands"),
    [
        ("robot", ["hoap3 report 'my log'", "hoap3 report 'my log' CONTROLLER_LOG"]),
        ("controller", ["hoap3 report ROBOT_LOG 'my log'"]),
    ],
)
def test_a_service_ends_with_the_reports_of_its_log(
    side: str, commands: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    show_next_of_service(Path("my log"), side=side)
    lines = capsys.readouterr().err.splitlines()
    shown = [line.removeprefix("next:").strip().partition("     ")[0] for line in lines]
    assert shown == commands
    show_next_of_service(None, side=side)
    assert not capsys.readouterr().err
