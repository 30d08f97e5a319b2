"""The paper's displacement on HOAP-3 in MuJoCo: on one held foot, and on its own two feet.

Servos give way, and the loop is closed: kinematics from the encoders, integration from the
reference.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hoap3.protocol.runtime.recorder import MemoryRecorder
from hoap3.remote_controller.config import read_config as controller_config
from hoap3.robot_emulator.config import read_config as emulator_config
from hoap3.robot_emulator.plants.mujoco.plant import MujocoPlant
from hoap3.tools.reproduce.figures import Array, Axis, Curve, Figure, Panel, level, lines
from hoap3.tools.reproduce.papers.qp12.experiments import PERIOD_S, TARGET_M, law_settings
from hoap3.tools.reproduce.papers.qp12.reference import TRIALS, Law
from hoap3.tools.reproduce.rows import Row, bounded, measured
from hoap3.tools.simulate import Lockstep, controller_settings, emulator_settings

SECONDS = 20.0
NOISE_RAD = 1e-4
LAWS = (*TRIALS, Law(0.99, adaptive=False), Law(None))
SHOWN_EVERY = 20  # ticks
NEAR_MM, RISE_MM, STANDING_MM, TILT_DEG = 0.3, 0.5, 0.5, 1.0
"""What must hold: |e| at the end on one foot, √(2(V − least V so far)), |e| and tilt standing."""
FALLEN_MM = 1e3 * TARGET_M[2] / 2.0
"""|e| that is a fall: half the height that the centre of mass shall have above the sole."""


@dataclass(frozen=True, eq=False)
class Stood:
    """What became of the robot.

    Attributes:
        error: of the simulated centre of mass in the right sole's frame, (ticks, 3) [m].
        told: the plant's own figures at the end.
        certified: answers that were certified, of all.
        saturated: periods in which a motor gave all that it could.
    """

    error: Array
    told: Mapping[str, Any]
    certified: tuple[int, int]
    saturated: int

    @property
    def end_mm(self) -> float:
        """|e| at the end."""
        return 1e3 * float(np.linalg.norm(self.error[-1]))

    @property
    def rise_mm(self) -> float:
        """√(2(V − least V so far)), the greatest."""
        v = 0.5 * np.sum(self.error**2, axis=1)
        return 1e3 * float(np.sqrt(2.0 * (v - np.minimum.accumulate(v)).max()))

    @property
    def tilt_deg(self) -> float:
        """The greatest tilt of any sole."""
        return float(max(self.told["largest_tilt_deg"].values()))

    @property
    def lifted(self) -> int:
        """Periods in which a sole carried nothing."""
        return sum(self.told["periods_off_the_ground"].values())

    @property
    def beside_mm(self) -> float:
        """How far the simulated centre of mass is from the target in the world, not in the sole."""
        return 1e3 * float(np.linalg.norm(np.array(self.told["com_world_m"]) - TARGET_M))


def stand(
    robot: str,
    controller: Mapping[str, Any],
    seconds: float = SECONDS,
    seed: int = 0,
    **plant: Any,
) -> Stood:
    """Bring the centre of mass to m_d.

    Args:
        robot: emulator config.
        controller: settings.
        seconds: how long.
        seed: of the noise.
        plant: other `plant.parameters`.
    """
    content, _ = emulator_config(robot)
    content["plant"]["parameters"] |= plant
    settings = emulator_settings(content, seed)
    log = MemoryRecorder()
    lockstep = Lockstep(settings, controller_settings(controller), MemoryRecorder(), log)
    body, places = lockstep.robot.plant, []
    if not isinstance(body, MujocoPlant):
        raise TypeError(f"{robot} is no body in MuJoCo")

    def look() -> bool:
        places.append(body.balance.com_in_sole())
        return False

    lockstep.run(seconds, look)
    told = lockstep.controller_loop.summary or {}
    counts = told["certified"], told["certifiable"]
    return Stood(np.array(places) - TARGET_M, body.summary(), counts, body.saturated)


def one_foot(
    say: Callable[[str], None] = lambda _: None, seconds: float = SECONDS
) -> dict[tuple[Law, float], Stood]:
    """Each law without noise, and pinv, γ = 0 and γ = 0.99 with it."""
    trials = [(law, 0.0) for law in LAWS]
    trials += [(law, NOISE_RAD) for law in (LAWS[0], *LAWS[-2:])]
    found = {}
    for law, noise in trials:
        say(f"MuJoCo, one foot, {law}{', noise' if noise else ''}: {seconds:g} s")
        settings = law_settings(law)
        found[law, noise] = stand("hoap3_one_foot", settings, seconds, noise_rad=noise)
    return found


def both_feet(
    say: Callable[[str], None] = lambda _: None, seconds: float = SECONDS
) -> dict[str, Stood]:
    """`stable_qp_standing`, which keeps both soles, and QP12, which knows of one only."""
    kept, _ = controller_config("stable_qp_standing")
    trials = {
        "stable_qp, both soles kept": (kept, 0.0),
        "stable_qp, both soles kept, noise": (kept, NOISE_RAD),
        **{f"QP12, {law}": (law_settings(law), 0.0) for law in (LAWS[0], LAWS[5], *LAWS[-2:])},
    }
    found = {}
    for name, (settings, noise) in trials.items():
        say(f"MuJoCo, standing, {name}: {seconds:g} s")
        found[name] = stand("hoap3_standing", settings, seconds, noise_rad=noise)
    return found


def too_fast(say: Callable[[str], None] = lambda _: None) -> Stood:
    """Ψ without 1/√n around servos of half the damping: beyond what they can follow."""
    say("MuJoCo, one foot, kv 6, psi_scale one: 5 s")
    return stand("hoap3_one_foot", law_settings(LAWS[0], "C"), 5.0, kv=6.0)


def draw(held: Mapping[tuple[Law, float], Stood], standing: Mapping[str, Stood]) -> Figure:
    """|e| of the simulated centre of mass over time."""
    foot = {f"{law}{', noise' if noise else ''}": stood for (law, noise), stood in held.items()}
    shown = {name: foot[name] for name in list(foot)[:1] + list(foot)[10:13] + list(foot)[-1:]}
    panels = (
        _panel("one_foot", "on one held foot", shown, NEAR_MM),
        _panel("standing", "on both feet", standing, STANDING_MM),
    )
    title = "HOAP-3 in MuJoCo: distance of its centre of mass from m_d, in the right sole"
    return Figure("own_feet", title, (panels,), (13.0, 4.5))


def _panel(name: str, title: str, shown: Mapping[str, Stood], bar: float) -> Panel:
    data = {}
    for label, stood in shown.items():
        e = np.asarray(1e3 * np.linalg.norm(stood.error, axis=1), np.float64)
        time_s = PERIOD_S * np.arange(len(e), dtype=np.float64)
        data[label] = (time_s[::SHOWN_EVERY], e[::SHOWN_EVERY])
    end = max(float(x[-1]) for x, _ in data.values())
    curves: list[Curve] = [*lines(data), level(f"bar, {name}", (0.0, end), bar, legend="bar")]
    time, error = Axis("time_s", "time [s]", (0.0, end)), Axis("e_mm", "|e| [mm]", log=True)
    return Panel(name, title, time, error, curves)


def rows(
    held: Mapping[tuple[Law, float], Stood], standing: Mapping[str, Stood], beyond: Stood
) -> list[Row]:
    """Rows with the bars above, and measurements where the paper's law knows nothing of a foot."""
    servos = (
        "MuJoCo, servos of 600 N m/rad and 12 N m s/rad, peak torques; kinematics from the "
        "encoders, integration from the reference"
    )
    noisy = f"{servos}; noise of {1e3 * NOISE_RAD:g} mrad"
    made = []
    for (law, noise), stood in held.items():
        item = f"one foot, {law}{', noise' if noise else ''}: |e| of the physics after 20 s"
        why = noisy if noise else servos
        made.append(bounded(item, None, stood.end_mm, (None, NEAR_MM), why, unit="mm"))
    rise = max(stood.rise_mm for stood in held.values())
    why = "√(2·(V − least V so far)) of the simulated centre of mass, the worst of these runs"
    made.append(bounded("one foot: rise of V", None, rise, (None, RISE_MM), why, unit="mm"))
    for name, stood in standing.items():
        item = f"standing, {name}:"
        if not name.startswith("stable_qp"):
            why = "the law knows of one sole only, and turns it on the floor: no bar"
            made.append(measured(f"{item} |e| in the sole", None, stood.end_mm, why, unit="mm"))
            made.append(measured(f"{item} tilt", None, stood.tilt_deg, why, unit="°"))
            continue
        both = f"{servos}; fixed_frame keeps the left sole, seen from the right one"
        bars = (
            ("|e| of the physics in the sole", stood.end_mm, STANDING_MM, "mm"),
            ("tilt of a sole", stood.tilt_deg, TILT_DEG, "°"),
            ("periods with a sole off the ground", stood.lifted, 0.0, ""),
        )
        made += [
            bounded(f"{item} {what}", None, ours, (None, bar), both, unit=unit)
            for what, ours, bar, unit in bars
        ]
        why = "soles give way to the floor, so the world sees another place than the sole"
        made.append(measured(f"{item} |e| in the world", None, stood.beside_mm, why, unit="mm"))
    limit = beyond.told["servo_rate_limit_1_s"]
    certified, certifiable = beyond.certified
    why = f"faster than the servos, {limit:.2f} 1/s: it falls, and nothing is certified"
    item, fallen = "psi_scale one, kv 6:", (FALLEN_MM, None)
    return [
        *made,
        bounded(f"{item} |e| after 5 s", None, beyond.end_mm, fallen, why, unit="mm"),
        bounded(f"{item} certified answers", None, certified, (0.0, 0.0), why),
        bounded(f"{item} answers to certify", None, certifiable, (1.0, None), why),
    ]
