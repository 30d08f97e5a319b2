"""Colours of a report, by role, for light and for dark pages.

Figures are drawn with the light ones; `canvas` then writes the role in their place, so that a page
decides by its own scheme.
"""

from __future__ import annotations

COLOURS = {  # light, dark
    "ink": ("#1c2430", "#e4e8ec"),
    "soft": ("#5d6875", "#98a4b0"),
    "rule": ("#dfe3e7", "#2e363f"),
    "page": ("#fafaf8", "#12161b"),
    "card": ("#ffffff", "#191e25"),
    "blue": ("#2b6cb0", "#6ea8e5"),
    "orange": ("#d17a22", "#eba15a"),
    "green": ("#2f9168", "#5fc096"),
    "red": ("#c53f3a", "#ee7f78"),
    "violet": ("#7f5bb5", "#b296e0"),
    "cyan": ("#2798ab", "#62c4d4"),
    "olive": ("#96811d", "#ccb650"),
    "pink": ("#c0558f", "#e28fbd"),
    "brown": ("#9a6b4f", "#c79a7e"),
    "faint": ("#aab3bd", "#57626e"),
    "wash": ("#e9eff6", "#1f2a37"),
}
LIGHT = {role: light for role, (light, _) in COLOURS.items()}
SERIES = ("blue", "orange", "green", "violet", "red", "cyan", "olive")
"""Roles of curves, in the order in which they are given out."""
