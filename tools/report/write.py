"""Makes a report: reads the logs, computes, draws, and writes the page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from hoap3.protocol.errors import UsageError
from hoap3.tools.logs.atomic_write import whole_file
from hoap3.tools.report.content import read_content
from hoap3.tools.report.page import page
from hoap3.tools.report.sources import of_ours


def write_report(
    log: Path,
    out: Path | None = None,
    say: Callable[[str], None] = lambda _: None,
    robot: str | None = None,
    *,
    allow_code: bool = False,
) -> dict[str, Any]:
    """Write the report of a log.

    Args:
        log: folder of a run, or one `*.mcap`.
        out: the file; None for `report.html` beside the log. An earlier report is replaced.
        say: takes what is being done.
        robot: name or path of the robot on this machine, whose meshes are drawn.
        allow_code: import what the log names by a dotted path, to repeat its controller.

    Returns:
        its figures, as `--json` prints them, with the path of the page as `report`, and whether it
        `replaced` an earlier one.

    Raises:
        LogError: there is no log of ours.
        UsageError: `out` cannot be written.
    """
    say("reading the log")
    content = read_content(log, robot, allow_code=allow_code)
    say("drawing")
    with of_ours(log):
        drawn = page(content)
    target = out or (log if log.is_dir() else log.parent) / "report.html"
    replaced = target.is_file()
    try:
        with whole_file(target) as draft:
            draft.write_text(drawn, encoding="utf-8", errors="replace")
    except OSError as error:
        reason = error.strerror or "no reason given"
        raise UsageError(
            f"{target}: cannot be written ({reason}). Choose another place with --out"
        ) from error
    return {**content.as_json(), "report": str(target), "replaced": replaced}
