"""Where a picture is taken from: an eye so far away that lines which are parallel stay so."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hoap3.protocol.messages import FloatArray

AZIMUTH_DEG, ELEVATION_DEG = 38.0, 18.0
SMALLEST_M = 0.01  # that fills a picture


@dataclass(frozen=True, eq=False)
class Camera:
    """An eye, and the picture that it sees.

    Attributes:
        right, up, toward: (3,) directions in the world: of x and −y of the picture, and to the eye.
        middle: (2,), what is seen in the middle of the picture, along `right` and `up` [m].
        scale: [px/m].
        width, height: of the picture [px].
    """

    right: FloatArray
    up: FloatArray
    toward: FloatArray
    middle: FloatArray
    scale: float
    width: float
    height: float

    @classmethod
    def around(
        cls,
        points: FloatArray,
        width: float,
        height: float,
        margin: float = 0.0,
        azimuth_deg: float = AZIMUTH_DEG,
        elevation_deg: float = ELEVATION_DEG,
    ) -> Camera:
        """One that sees all points, (m, 3) [m], m > 0, at least `margin` [px] from the edge.

        Args:
            points: of the world.
            width, height, margin: of the picture [px].
            azimuth_deg: of the eye, from the x axis towards the y axis [deg].
            elevation_deg: of the eye, above the floor [deg].
        """
        a, e = math.radians(azimuth_deg), math.radians(elevation_deg)
        right = np.array([-math.sin(a), math.cos(a), 0.0])
        toward = np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])
        up = np.cross(toward, right)
        seen = points @ np.column_stack((right, up))
        low, high = seen.min(axis=0), seen.max(axis=0)
        room = np.array([width, height]) - 2.0 * margin
        scale = float((room / np.maximum(high - low, SMALLEST_M)).min())
        return cls(right, up, toward, (low + high) / 2.0, scale, width, height)

    @property
    def axes(self) -> FloatArray:
        """(3, 3), `right`, `up` and `toward` as rows."""
        return np.stack((self.right, self.up, self.toward))

    def project(self, points: FloatArray) -> FloatArray:
        """Where points, (…, 3) [m], are in the picture, (…, 2): x to the right, y down [px]."""
        seen = np.stack((points @ self.right, points @ self.up), axis=-1) - self.middle
        half = np.array([self.width, self.height]) / 2.0
        return np.asarray(half + seen * np.array([self.scale, -self.scale]))
