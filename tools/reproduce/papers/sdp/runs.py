"""The runs behind Figs. 1 to 7."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from hoap3.tools.reproduce.papers.sdp.loop import Run, constant, scheduled
from hoap3.tools.reproduce.papers.sdp.reference import DT_S, FAST, LOW_LIMIT_RAD_S, PERIODS_S, SLOW

TICK_S = 1e-3  # of our robots


@dataclass(frozen=True)
class Runs:
    """All with the paper's tasks.

    Attributes:
        constant, slow, fast: of Figs. 1 to 4: constant gains, β̃ = 2 and 8.
        limited: of Fig. 5, with the lower limit.
        periods: of Figs. 6 and 7, by Δt [s]; `fast` is among them.
        tick: as `fast`, at 1 kHz; not in the paper.
    """

    constant: Run
    slow: Run
    fast: Run
    limited: Run
    periods: Mapping[float, Run]
    tick: Run

    @property
    def scheduled(self) -> dict[str, Run]:
        """Those with a certificate, by name."""
        named = {f"β̃ = {SLOW:g}": self.slow, f"β̃ = {FAST:g}": self.fast}
        named[f"β̃ = {FAST:g}, {LOW_LIMIT_RAD_S:g} rad/s"] = self.limited
        others = {dt: run for dt, run in self.periods.items() if run is not self.fast}
        named |= {f"β̃ = {FAST:g}, Δt = {dt:g} s": run for dt, run in others.items()}
        return {**named, f"β̃ = {FAST:g}, Δt = {TICK_S:g} s": self.tick}


def run_all(say: Callable[[str], None] = lambda _: None) -> Runs:
    """Do them."""
    say("Figs. 1 to 5: the UR5 with constant gains, β̃ = 2 and 8")
    slow, fast = scheduled(SLOW), scheduled(FAST)
    limited = scheduled(FAST, limit=LOW_LIMIT_RAD_S)
    say("Figs. 6 and 7: other periods")
    periods = {dt: fast if dt == DT_S else scheduled(FAST, dt) for dt in PERIODS_S}
    return Runs(constant(), slow, fast, limited, periods, scheduled(FAST, TICK_S))
