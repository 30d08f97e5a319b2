"""Other readings of "the y coordinate of the 4th joint", another base, and the emulator's UR5."""

from __future__ import annotations

from dataclasses import dataclass

from hoap3.tools.reproduce.papers.sdp import reference as ref
from hoap3.tools.reproduce.papers.sdp.arm import toolbox
from hoap3.tools.reproduce.papers.sdp.claims import LESS
from hoap3.tools.reproduce.papers.sdp.configured import ConfiguredTasks
from hoap3.tools.reproduce.papers.sdp.loop import Run, scheduled
from hoap3.tools.reproduce.rows import Row, bounded, measured, near

CONFIG, ROBOT, POSTURE = "clik_sdp_ur5", "ur5", "outstretched"
COMPARED_S = (0.5, 1.0, 3.0)
STUCK_BETA, STUCK_V = 1e-3, 0.5  # 1/s, of V(0)


@dataclass(frozen=True)
class Conventions:
    """Runs of β̃ = 8.

    Attributes:
        frame_3: the wrist is the origin of frame {3}, which lies on the axis of joint 4.
        turned: the base is turned by 180° about z, the targets are not.
        ours: the emulator's UR5 and the tasks of `clik_sdp_ur5`.
    """

    frame_3: Run
    turned: Run
    ours: Run


def run_all() -> Conventions:
    """Do them."""
    return Conventions(
        scheduled(ref.FAST, tasks=toolbox(3)),
        scheduled(ref.FAST, tasks=toolbox(turned=True)),
        scheduled(ref.FAST, tasks=ConfiguredTasks(CONFIG, ROBOT, POSTURE)),
    )


def rows(fast: Run, runs: Conventions) -> list[Row]:
    """Beside the run that fits."""
    made = [
        measured("frame {3}: V(0)", None, runs.frame_3.v[0], _FRAME_3, unit="m²"),
        measured("frame {3}: e₂(0)", None, runs.frame_3.errors[0, 3], _FRAME_3, unit="m"),
        bounded("frame {3}: V⁺/V, greatest", "decreases monotonically", runs.frame_3.rise,
                (None, LESS), _FRAME_3),
        measured("frame {3}: β in the end", None, runs.frame_3.beta[-1], _FRAME_3, unit="1/s"),
        measured("turned base: V(0)", None, runs.turned.v[0], _TURNED, unit="m²"),
        bounded("turned base: V in the end / V(0)", None, runs.turned.v[-1] / runs.turned.v[0],
                (STUCK_V, None), _TURNED),
        bounded("turned base: β in the end", None, runs.turned.beta[-1], (0.0, STUCK_BETA),
                _TURNED, unit="1/s"),
    ]  # fmt: skip
    for time in COMPARED_S:
        step, item = fast.at(time), f"the emulator's UR5: V({time:g} s) / the toolbox's"
        made.append(near(item, None, runs.ours.v[step] / fast.v[step], 1.0, _OURS))
    return made


_FRAME_3 = (
    "The paper's words fit this frame as well, and the second error is then nil at the start; the "
    "authors' code takes frame {4}, and the figures are of that"
)
_TURNED = (
    "With a base as that of ROS the run ends where the tasks depend on each other: it cannot be "
    "the paper's. Whoever has such a description negates x and y of the targets"
)
_OURS = (
    "The toolbox has 89.459 mm where Universal Robots has 89.159 mm from the base to the shoulder, "
    "and so has our URDF"
)
