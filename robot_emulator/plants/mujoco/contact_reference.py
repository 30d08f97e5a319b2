"""What contacts press on links as frames feel it, in plain numpy.

`contact_kernels` is compared with it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def felt(torque: Array, force: Array, about: Array, place: Array, axes: Array) -> Array:
    """Force and torque (6,) about a frame, in its axes, of a torque and a force about a point.

    The wrench moves as f, t + (p − o) × f, and turns with Rᵀ; torque, force, `about` p and `place`
    o are (3,) in the world, `axes` R (3, 3) is the frame in the world.
    """
    moved = torque + np.cross(about - place, force)
    return np.hstack([axes.T @ force, axes.T @ moved])
