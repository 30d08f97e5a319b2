"""Figures in the attributes of a URDF; what is no figure is an error that names the place."""

from __future__ import annotations

import math
from xml.etree import ElementTree as ET

import numpy as np

from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.messages import FloatArray


def figure(element: ET.Element | None, attribute: str, where: str) -> float | None:
    """A number, possibly infinite; None where it is not given.

    Raises:
        DescriptionError: not a number, or NaN.
    """
    text = None if element is None else element.get(attribute)
    if element is None or text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise DescriptionError(
            f"{where}: <{element.tag} {attribute}>: found {text[:60]!r}. Write a number."
        )
    return value


def triple(element: ET.Element | None, attribute: str, where: str, otherwise: float) -> FloatArray:
    """Three finite numbers, (3,); all `otherwise` where they are not given.

    Raises:
        DescriptionError: not three finite numbers.
    """
    text = None if element is None else element.get(attribute)
    if element is None or text is None:
        return np.full(3, otherwise)
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != 3 or not all(map(math.isfinite, values)):
        raise DescriptionError(
            f"{where}: <{element.tag} {attribute}>: found {text[:60]!r}. Write 3 finite numbers."
        )
    return np.array(values)


def written(values: FloatArray | tuple[float, ...]) -> str:
    """Figures as text, to 1e-9."""
    return " ".join(f"{round(float(value), 9) + 0.0:.12g}" for value in values)
