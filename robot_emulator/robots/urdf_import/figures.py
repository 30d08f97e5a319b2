"""Figures in the attributes of a URDF; what is no figure is an error that names the place."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np

from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.urdf import is_finite, xacro_hint


def figure(element: ET.Element | None, attribute: str, where: str) -> float | None:
    """A number, possibly infinite; None where it is not given.

    Raises:
        DescriptionError: not a number, or NaN.
    """
    text = None if element is None else element.get(attribute)
    if element is None or text is None:
        return None
    number = text.strip()
    if not (is_finite(number) or number.lower().lstrip("+-") in {"inf", "infinity"}):
        raise DescriptionError(
            f"{where}: <{element.tag} {attribute}>: found {text[:60]!r}. Write a number"
            f"{xacro_hint(text)}."
        )
    return float(number)


def triple(
    element: ET.Element | None, attribute: str, where: str, otherwise: float, count: int = 3
) -> FloatArray:
    """Three finite numbers, or `count` of them, (count,); all `otherwise` if they are not given.

    Raises:
        DescriptionError: not so many finite numbers.
    """
    text = None if element is None else element.get(attribute)
    if element is None or text is None:
        return np.full(count, otherwise)
    words = text.split()
    if len(words) != count or not all(map(is_finite, words)):
        raise DescriptionError(
            f"{where}: <{element.tag} {attribute}>: found {text[:60]!r}. Write {count} finite "
            f"numbers{xacro_hint(text)}."
        )
    return np.array([float(word) for word in words])


def written(values: FloatArray | tuple[float, ...]) -> str:
    """Figures as text, to 1e-9."""
    return " ".join(f"{round(float(value), 9) + 0.0:.12g}" for value in values)
