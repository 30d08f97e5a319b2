"""What the paper prints: settings of its runs, section V. Its results are curves without numbers.

`oracle` computes the runs independently.
"""

from __future__ import annotations

DT_S, LIMIT_RAD_S = 0.01, 6.0
CONSTANT = (2.0, 2.0, 2.0, 1.0)
"""Gains [1/s] that stay as they are."""

SLOW, FAST = 2.0, 8.0
"""β̃ of the paper [1/s]."""

LOW_LIMIT_RAD_S = 4.0
"""The other limit of Fig. 5."""

PERIODS_S = (0.1, 0.05, 0.01, 0.005)
"""Δt of Figs. 6 and 7, the default one among them."""

V_S = (0.1, 0.5, 1.0, 2.0, 3.0)
BETA_S = (0.0, 0.2, 1.0, 3.0)
"""When V and β are compared."""

WRIST_WEIGHT = 0.09
"""w of the second task where weights are shown."""
