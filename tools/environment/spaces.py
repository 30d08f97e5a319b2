"""Spaces of observations and actions, and the base of environments: gymnasium's, or the like.

Where the package `gymnasium` is installed, its own classes are used; where it is not, those here,
which have what an agent needs of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from hoap3.protocol.messages import FloatArray


class PlainBox:
    """All arrays between two others; as `gymnasium.spaces.Box`.

    Args:
        low, high: ends, of one shape; infinite where there is none.

    Attributes:
        low, high: see above.
        shape, dtype: of the arrays.
    """

    def __init__(
        self, low: FloatArray, high: FloatArray, dtype: type[np.float64] = np.float64
    ) -> None:
        self.low, self.high = np.array(low, dtype), np.array(high, dtype)
        self.shape, self.dtype = self.low.shape, np.dtype(dtype)
        self._random = np.random.default_rng()

    def __repr__(self) -> str:
        return f"Box({self.low}, {self.high})"

    def __contains__(self, value: object) -> bool:
        return self.contains(value)

    def contains(self, value: object) -> bool:
        """Whether an array lies inside."""
        found = np.asarray(value)
        within = found.shape == self.shape and np.can_cast(found.dtype, self.dtype)
        return bool(within and (found >= self.low).all() and (found <= self.high).all())

    def seed(self, seed: int | None = None) -> None:
        """Begin the random numbers of `sample` anew."""
        self._random = np.random.default_rng(seed)

    def sample(self) -> FloatArray:
        """Draw an array: uniform between its ends, standard normal where one is infinite."""
        bounded = np.isfinite(self.low) & np.isfinite(self.high)
        low, high = np.where(bounded, self.low, 0.0), np.where(bounded, self.high, 1.0)
        drawn = self._random.uniform(low, high)
        normal = np.clip(self._random.standard_normal(self.shape), self.low, self.high)
        return np.where(bounded, drawn, normal)


class PlainDict(Mapping[str, PlainBox]):
    """Arrays by name, each from a space of its own; as `gymnasium.spaces.Dict`.

    Attributes:
        spaces: by name.
    """

    def __init__(self, spaces: Mapping[str, PlainBox]) -> None:
        self.spaces = dict(spaces)

    def __repr__(self) -> str:
        return f"Dict({self.spaces})"

    def __getitem__(self, name: str) -> PlainBox:
        return self.spaces[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.spaces)

    def __len__(self) -> int:
        return len(self.spaces)

    def __contains__(self, value: object) -> bool:
        return self.contains(value) if isinstance(value, Mapping) else value in self.spaces

    def contains(self, value: object) -> bool:
        """Whether there is an array for each name, and no other, and each lies in its space."""
        return (
            isinstance(value, Mapping)
            and value.keys() == self.spaces.keys()
            and all(value[name] in space for name, space in self.spaces.items())
        )


class PlainEnv:
    """What `gymnasium.Env` gives to its subclasses.

    Attributes:
        np_random: random numbers of the environment, from the seed of `reset`.
        unwrapped: the environment itself.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}
    render_mode: str | None = None
    spec: Any = None
    _np_random: np.random.Generator | None = None

    @property
    def np_random(self) -> np.random.Generator:
        """See above; where no seed was ever given, from the operating system's."""
        if self._np_random is None:
            self._np_random = np.random.default_rng()
        return self._np_random

    @property
    def unwrapped(self) -> Self:
        """See above."""
        return self

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Begin the random numbers anew where a seed is given, with those that gymnasium draws."""
        del options
        if seed is not None:
            sequence = np.random.SeedSequence(seed)
            self._np_random = np.random.Generator(np.random.PCG64(sequence))

    def close(self) -> None:
        """Nothing is open."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


if TYPE_CHECKING:
    Box = PlainBox
    Dict = PlainDict
    Env = PlainEnv
else:
    try:
        from gymnasium import Env
        from gymnasium.spaces import Box, Dict
    except ImportError:
        Box, Dict, Env = PlainBox, PlainDict, PlainEnv
