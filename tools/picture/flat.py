"""What a picture is made of: things in two dimensions, painted one over the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from hoap3.protocol.messages import FloatArray

Form = Literal["face", "line", "loop", "dash", "dot", "ring", "cross"]


@dataclass(frozen=True, eq=False)
class Flat:
    """One thing.

    Attributes:
        form: face: filled; line: through its points; loop: one that is closed; dash: one with
            gaps; dot, ring, cross: at its first point.
        points: (k, 2), x to the right, y down [px].
        role: its colour, of `hoap3.tools.html.palette`.
        size: width of a line; radius of a dot, a ring or a cross [px].
        opacity: of a face.
    """

    form: Form
    points: FloatArray
    role: str
    size: float = 1.5
    opacity: float = 1.0
