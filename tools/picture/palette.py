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
    "floor": ("#f1f3f5", "#1d232b"),
    "shadow": ("#d9dee4", "#0f1318"),
    "support": ("#cfe8dc", "#1f4a3a"),
}
SHADES = 16
"""Levels of light of the surfaces of a robot; level 0 is the darkest, as `body0`."""

BODY = ("#46556a", "#f4f6f9"), ("#232c37", "#b4c2d0")  # light, dark: from darkest to lightest


def _between(dark: str, light: str, share: float) -> str:
    """A colour on the way from one to another."""
    ends = zip(bytes.fromhex(dark[1:]), bytes.fromhex(light[1:]), strict=True)
    return "#" + bytes(round(a + share * (b - a)) for a, b in ends).hex()


for _level in range(SHADES):
    _light, _dark = (_between(*scheme, _level / (SHADES - 1)) for scheme in BODY)
    COLOURS[f"body{_level}"] = _light, _dark
LIGHT = {role: light for role, (light, _) in COLOURS.items()}
SERIES = ("blue", "orange", "green", "violet", "red", "cyan", "olive")
"""Roles of curves, in the order in which they are given out."""
