"""What the solvers of several tasks are given."""

from __future__ import annotations

from typing import NamedTuple

from hoap3.protocol.messages import FloatArray


class Problem(NamedTuple):
    """Tasks J·x → b within bounds, with x, (n,), the unknown.

    Of a robot that is fixed to the ground x is ddq; of one with a free base it is what contacts
    leave (`solvers.contact.reduction`), and limits of joints and torques are rows.

    Attributes:
        jacobian, wanted: of the tasks, J (m, n) and b (m,).
        with_rest: the same, and below it the rows that brake, n of them.
        towards: what x shall be where nothing else counts, (n,).
        mass, bias: τ = M·x + h, (n, n) and (n,).
        lower, upper: of x, (n,).
        rows, rows_lower, rows_upper: lower ≤ G·x ≤ upper, (s, n) and (s,).
    """

    jacobian: FloatArray
    wanted: FloatArray
    with_rest: tuple[FloatArray, FloatArray]
    towards: FloatArray
    mass: FloatArray
    bias: FloatArray
    lower: FloatArray
    upper: FloatArray
    rows: FloatArray
    rows_lower: FloatArray
    rows_upper: FloatArray
