"""Colours of a report, by role, for light and for dark pages.

Figures are drawn with the light ones; `canvas` then writes the role in their place, so that a page
decides by its own scheme.
"""

from __future__ import annotations

LIGHT = {
    "ink": "#1c2430",
    "soft": "#5d6875",
    "rule": "#dfe3e7",
    "page": "#fafaf8",
    "card": "#ffffff",
    "blue": "#2b6cb0",
    "orange": "#d17a22",
    "green": "#2f9168",
    "red": "#c53f3a",
    "violet": "#7f5bb5",
    "cyan": "#2798ab",
    "olive": "#96811d",
    "pink": "#c0558f",
    "brown": "#9a6b4f",
    "faint": "#aab3bd",
    "wash": "#e9eff6",
}
DARK = {
    "ink": "#e4e8ec",
    "soft": "#98a4b0",
    "rule": "#2e363f",
    "page": "#12161b",
    "card": "#191e25",
    "blue": "#6ea8e5",
    "orange": "#eba15a",
    "green": "#5fc096",
    "red": "#ee7f78",
    "violet": "#b296e0",
    "cyan": "#62c4d4",
    "olive": "#ccb650",
    "pink": "#e28fbd",
    "brown": "#c79a7e",
    "faint": "#57626e",
    "wash": "#1f2a37",
}
SERIES = ("blue", "orange", "green", "violet", "red", "cyan", "olive")
"""Roles of curves, in the order in which they are given out."""
