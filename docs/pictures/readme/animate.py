"""Makes the moving pictures of the README: `python docs/pictures/readme/animate.py [NAME …]`.

Each is rendered from what a run in lockstep recorded, so it is the same wherever it is made.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from canvas import Canvas

from hoap3.protocol.messages import Target
from hoap3.protocol.robot.description import COM
from hoap3.remote_controller.config import read_config as controller_content
from hoap3.robot_emulator.robots import load
from hoap3.tools.analysis.report.motion import point_path
from hoap3.tools.logs.log import Log
from hoap3.tools.picture.body import Body
from hoap3.tools.picture.marks import Marks
from hoap3.tools.picture.stage import Stage
from hoap3.tools.picture.svg import Flat
from hoap3.tools.services.configs import load_controller_config, load_emulator_config
from hoap3.tools.services.run import run_lockstep
from hoap3.tools.services.simulate import simulate

FOLDER = Path(__file__).parent
SIZE = (560, 500)  # px; a page shows it at two thirds of that
LEGEND = 34  # px at its lower edge
RATE = 15  # pictures a second
ROUND_S = 5.0  # after which it begins again, where it ends
START_S = 2.5  # before which motions are not yet the same in every round
FACES = 2000
Array = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True, eq=False)
class Film:
    """What is shown.

    Attributes:
        robot: its name.
        q: (m, n) joint positions of each picture [rad].
        marks: of each picture, in the world.
        legend: role and mark of each entry, and its text.
        seen_from: `azimuth_deg` and `elevation_deg` of the camera.
    """

    robot: str
    q: Array
    marks: list[Marks]
    legend: tuple[tuple[str, str, str], ...]
    seen_from: dict[str, float]

    def pictures(self) -> Iterator[Any]:
        """Every picture, as an image of Pillow."""
        body = Body(load(self.robot), FACES)
        placements = [body.place(row) for row in self.q]
        room = (SIZE[0], SIZE[1] - LEGEND)
        stage = Stage.around(body, placements, self.marks, room, 14.0, **self.seen_from)
        for placement, marks in zip(placements, self.marks, strict=True):
            canvas = Canvas(*SIZE)
            canvas.paint(stage.paint(placement, marks))
            self._write_legend(canvas)
            yield canvas.image

    def _write_legend(self, canvas: Canvas) -> None:
        y, x = SIZE[1] - LEGEND / 2.0, 22.0
        for role, form, text in self.legend:
            end = np.array([[x, y], [x + 16.0, y]])
            size = 2.5 if form in {"line", "dash"} else 6.0
            at = end if form in {"line", "dash"} else end.mean(axis=0, keepdims=True)
            canvas.paint([Flat(form, at, role, size)])
            x += 49.0 + canvas.write((x + 24.0, y), text, "ink", 15.0, "lm")


def chosen(times: Array, start_s: float, count: int) -> Array:
    """Which rows show one round that begins at a time."""
    wanted = start_s + ROUND_S * np.arange(count) / count
    return np.searchsorted(times, wanted)


def behind(path: Array, place: int) -> Array:
    """What of a closed path was passed in the last second, up to here."""
    count = round(len(path) / ROUND_S)
    return path[np.arange(place - count, place + 1) % len(path)]


def closed(path: Array) -> Array:
    """A path that ends where it begins."""
    return np.vstack((path, path[:1]))


CORNERS = np.array([[-0.02, 0.03, 0.288], [0.0, 0.0, 0.252], [0.025, 0.028, 0.282]])  # [m]


def com(count: int) -> Film:
    """HOAP-3 brings its centre of mass to three places and back, both feet on the ground."""
    description, quarter = load("hoap3"), ROUND_S / 4
    visits = CORNERS[[0, 1, 2, 1, 0]]  # a way that is gone back leads back to the same posture
    times = (START_S + quarter * np.arange(5)).tolist()
    target = {"kind": "waypoints", "points_m": visits.tolist(), "times_s": times}
    law = {
        "controller": "stable_qp",
        "robot": "hoap3",
        "parameters": {
            "task": {"task": "com", "parameters": {"frame": "r_sole", "target": target}},
            "objective": {"kind": "qp12", "gamma": 0.0, "weights": {"waist_pitch": 100.0}},
            "psi": {"form": "exponential", "eta_per_s": 20.0},
            "constraints": [
                {"constraint": "joint_velocity", "parameters": {"limit_rad_s": 2.0}},
                {"constraint": "joint_position"},
                {"constraint": "support_polygon"},
                {"constraint": "fixed_frame", "parameters": {"frame": "l_sole"}},
            ],
        },
    }
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "run"
        emulator = load_emulator_config("hoap3", seed=0)[0]
        run_lockstep(emulator, load_controller_config(law)[0], START_S + ROUND_S, folder)
        states = Log.open(folder, "robot").states()
    rows = chosen((states["stamp_intended"] - states["stamp_intended"][0]) * 1e-9, START_S, count)
    q = np.asarray(states["q"][rows], float)
    path = point_path(q, description, COM, "r_sole")
    goals = visits[1 + (4 * np.arange(count)) // count]
    (sole,) = [each for each in description.soles if each.frame == "r_sole"]
    support = np.column_stack((sole.polygon, np.zeros(len(sole.polygon))))
    marks = [
        Marks(
            point=path[k],
            target=goals[k],
            path=behind(path, k),
            way=CORNERS,
            support=support,
            plumb=True,
        )
        for k in range(count)
    ]
    legend = (("blue", "dot", "centre of mass"), ("red", "ring", "target"),
              ("green", "line", "support polygon"))  # fmt: skip
    return Film("hoap3", q, marks, legend, {"azimuth_deg": 32.0, "elevation_deg": 14.0})


def hand(time_s: float) -> Array:
    """Where somebody drags the target: a closed curve in space, (3,) [m] in the base's axes."""
    a = 2.0 * np.pi * time_s / ROUND_S
    return np.array([
        -0.52 + 0.05 * np.cos(a),
        -0.1 + 0.22 * np.sin(a),
        0.38 + 0.13 * np.sin(2.0 * a + 0.6),
    ])  # fmt: skip


def dragged(count: int) -> Film:
    """The tool of UR5 follows a target that a client sends 20 times a second."""
    law, _ = controller_content("steered_ur5")
    target = law["parameters"]["tasks"][0]["parameters"]["target"]
    target |= {"speed_m_s": 1.0, "acceleration_m_s2": 6.0, "jerk_m_s3": 120.0}
    law["parameters"]["bounds"]["speed_rad_s"] = 2.5
    every = 50
    sent: dict[int, Array] = {}
    granted: dict[str, Any] = {}

    def steer(loop: Any) -> None:
        tick = loop.last_tick
        if tick == every:
            granted.update(loop.operate("acquire", "hand"))
        if tick >= every and tick % every == 0:
            message = Target(points=1, dimension=3)
            message.number, message.epoch = tick, granted["epoch"]
            message.session_id = granted["session_id"]
            message.values[:] = sent[tick] = hand(tick * 1e-3)
            loop.steer("hand", message.dump())

    done = simulate("ur5", law, START_S + ROUND_S, steer=steer)
    times = done.time - done.time[0]
    rows = chosen(times, START_S, count)
    q = np.asarray(done.states["q"][rows], float)
    path = point_path(q, load("ur5"), "tool0", "base")
    goals = np.array([sent[every * int(time * 1e3 / every)] for time in times[rows]])
    way = np.array([hand(time) for time in times[rows]])
    marks = [
        Marks(point=path[k], target=goals[k], path=behind(path, k), way=closed(way))
        for k in range(count)
    ]
    legend = (("blue", "dot", "tool"), ("red", "ring", "target that is dragged"))
    return Film("ur5", q, marks, legend, {"azimuth_deg": 150.0, "elevation_deg": 18.0})


FILMS: dict[str, Callable[[int], Film]] = {"com": com, "dragged": dragged}
"""Every film, by the name of its file."""


def make(name: str, folder: Path, rate: int = RATE) -> Path:
    """Make one.

    Args:
        name: of a film.
        folder: where its file goes.
        rate: pictures a second.
    """
    first, *others = FILMS[name](round(rate * ROUND_S)).pictures()
    path = folder / f"{name}.webp"
    first.save(path, save_all=True, append_images=others, duration=round(1000 / rate), loop=0,
               quality=80, method=6)  # fmt: skip
    return path


def main() -> int:
    """Make those that are named, or all."""
    wanted = sys.argv[1:] or [*FILMS]
    unknown = [name for name in wanted if name not in FILMS]
    if unknown:
        sys.stderr.write(f"no film {', '.join(unknown)}; there are {', '.join(FILMS)}\n")
        return 2
    for name in wanted:
        sys.stderr.write(f"{make(name, FOLDER)}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
