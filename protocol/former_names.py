"""Names that earlier versions used, and the error for each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

from hoap3.protocol.errors import UsageError

Kind = Literal["command", "config key", "constraint", "log", "method", "option", "task"]


class FormerName(NamedTuple):
    """A name that was renamed or removed.

    Attributes:
        kind: what had the name.
        old: the name; of an option, behind its command: `run --option`.
        new: what it is called today; None where it was removed.
        version: in which it changed.
        advice: what to do where it is more than to write the new name.
    """

    kind: Kind
    old: str
    new: str | None
    version: str
    advice: str = ""

    @property
    def problem(self) -> str:
        """What happened to the name."""
        change = f"renamed {self.new}" if self.new else "removed"
        return f"was {change} in version {self.version}"

    @property
    def remedy(self) -> str:
        """What to do."""
        return self.advice or (f"Write {self.new}" if self.new else "Leave it out")


_IN_CHECKOUT = "In a clone, run `python -m benchmarks.{}`"

FORMER_NAMES = (
    *(
        FormerName("command", f"bench {name}", None, "0.3", _IN_CHECKOUT.format(name))
        for name in ("gains", "hierarchy", "limits", "pushes", "scaling")
    ),
    *(
        FormerName("command", f"bench {name}", None, "0.3", _IN_CHECKOUT.format(f"load {name}"))
        for name in ("clients", "flood", "view")
    ),
    FormerName("command", "priorities", "change", "0.2"),
    FormerName("command", "prove", None, "0.3", "Run `python -m tests.proofs` in a clone"),
    FormerName("config key", "effort", "max_speed_ratio", "0.2"),
    FormerName(
        *("config key", "frame", "reference_frame", "0.3"),
        "Write reference_frame for the frame that the point is seen from, and point for the frame "
        "that moves (com for the centre of mass)",
    ),
    FormerName(
        *("config key", "kind", "task", "0.2"),
        "Write `task: frame_position`, frame_pose, posture or wrench for kind: position, pose, "
        "posture or force, and its settings under `parameters`",
    ),
    FormerName("config key", "keep_rho", None, "0.3"),
    FormerName("config key", "posture_rad", "target_rad", "0.2"),
    FormerName("constraint", "frame_still", "fixed_frame", "0.2"),
    FormerName("constraint", "joint_speed", "joint_velocity", "0.2"),
    FormerName("log", "wire version 1", None, "0.3", "Read the log with hoap3 0.2.0, the last one"),
    FormerName("method", "parts", None, "0.3", "Add to the list self.parts"),
    *(FormerName("method", name, "apply", "0.3") for name in ("fits", "stands_for", "tune")),
    FormerName("task", "force", "wrench", "0.2"),
    FormerName("task", "pose", "frame_pose", "0.2"),
    FormerName("task", "position", "frame_position", "0.2"),
)


def find_former_name(kind: str, old: str) -> FormerName | None:
    """Return the entry of a name, None where it never was one."""
    found = (each for each in FORMER_NAMES if (each.kind, each.old) == (kind, old))
    return next(found, None)


def find_former_method(kind: type) -> FormerName | None:
    """Return the entry of a method that a class outside hoap3 has instead of today's, or None."""
    own = {
        name
        for each in kind.__mro__
        if not each.__module__.startswith("hoap3.")
        for name in vars(each)
    }
    former = (each for each in FORMER_NAMES if each.kind == "method")
    return next((each for each in former if each.old in own and each.new not in own), None)


def check_command_line(words: Sequence[str]) -> None:
    """Refuse former commands and options.

    Args:
        words: of the command line, behind the program's name.

    Raises:
        UsageError: names what to write instead.
    """
    for former in FORMER_NAMES:
        command = former.old.split()
        option = command.pop() if former.kind == "option" else ""
        if former.kind not in {"command", "option"} or [*words[: len(command)]] != command:
            continue
        if not option or option in {word.partition("=")[0] for word in words}:
            raise UsageError(f"hoap3 {former.old}: {former.problem}. {former.remedy}")
