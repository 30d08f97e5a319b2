"""Compiled: what contacts press on links, as a frame of each feels it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import kernel


@kernel("void(f8[:,::1], f8[:,::1], b1[:,::1], f8[:,::1], f8[:,::1], f8, f8[::1])")
def feel(
    forces: FloatArray,
    about: FloatArray,
    felt: NDArray[np.bool_],
    places: FloatArray,
    axes: FloatArray,
    share: float,
    wrench: FloatArray,
) -> None:
    """Add a share of the wrenches of b bodies as k frames feel them.

    Args:
        forces: (b, 6) torque and force on each body, in the world's axes [N m, N].
        about: (b, 3) the point that the torque of each is about [m].
        felt: (k, b) whose forces each frame feels.
        places, axes: (k, 3) and (k, 9) origin [m] and rotation of each frame in the world.
        share: of the whole.
        wrench: (6k,) force and torque about each frame's origin, in its axes; changed in place.
    """
    for k in range(places.shape[0]):
        for b in range(forces.shape[0]):
            if not felt[k, b]:
                continue
            f = forces[b]
            x = about[b, 0] - places[k, 0]
            y = about[b, 1] - places[k, 1]
            z = about[b, 2] - places[k, 2]
            tx = f[0] + y * f[5] - z * f[4]
            ty = f[1] + z * f[3] - x * f[5]
            tz = f[2] + x * f[4] - y * f[3]
            for i in range(3):
                a, c, e = axes[k, i], axes[k, 3 + i], axes[k, 6 + i]
                wrench[6 * k + i] += share * (a * f[3] + c * f[4] + e * f[5])
                wrench[6 * k + 3 + i] += share * (a * tx + c * ty + e * tz)
