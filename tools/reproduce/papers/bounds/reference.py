"""What the paper prints, and what its equations give by an independent computation.

The paper prints hardly a figure. Where a set has a closed form, that is the reference; the others
were computed without this code, with the paper's limits. Digits are as that computation prints
them.
"""

from __future__ import annotations

VIABLE, VIABLE_AND_REACHABLE = 31.0 / 36.0, 13.0 / 18.0
"""Shares of F in Fig. 1, by 1 − V²/(12·A·Q): one corner a side, or two."""

CURVE_MEETS_SPEED = 1.0 / 6.0
"""Q − V²/(2A) in Fig. 1 [rad]."""

PSEUDO_ACCELERATION = {0.01: 0.855, 0.1: 0.793}
"""Share of F in Fig. 1 that velocity control leaves, by δt [s]."""

REGIONS = {
    "unreachable": 0.0670,
    "not viable": 0.0669,
    "position": 0.0021,
    "velocity": 0.1272,
    "ddq_max": 0.6181,
    "viability": 0.1187,
}
"""Shares of F in Fig. 3."""

NAIVE = {
    1.0: (0.160, 1.96),
    2.0: (0.139, 1.82),
    3.0: (0.116, 1.67),
    5.0: (0.086, 1.44),
    10.0: (0.0167, 0.54),
    20.0: (0.026, 0.41),
}
"""Fig. 4, naive: excess over q_max [rad] and speed at q_max [rad/s], by T_b/δt."""

CHATTER = 10.3
"""Fig. 4, proposed ×1: rms acceleration in the last half second of 2 s [rad/s²]."""

ELBOW = {2.0: (0.360, -1.382), 20.0: (0.62, -0.16)}
"""Fig. 5, naive: when the elbow reaches its limit [s], and how fast [rad/s], by T_b/δt."""

ELBOW_PRINTED = {2.0: (0.36, -1.4), 20.0: (None, -0.3)}
"""The same in the paper's text; it says 0.3 rad/s without a sign, and no time."""

LOG_NORM = 2.4e-3
"""Fig. 5: |log(H⁻¹H_d)| after 4 s."""

ELBOW_ACCELERATION = 31.0
"""Algorithm 4, 10⁶ random states: what e1 can accelerate in all of them [rad/s²]."""
