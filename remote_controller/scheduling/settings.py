"""Priorities as a config has them, and as they are changed while the robot moves."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from hoap3.protocol.config.settings import Settings

Alpha = Annotated[float, Field(strict=True, ge=0, le=1)]
Entry = tuple[str, str, Alpha]
Few = Field(max_length=100, fail_fast=True)  # the network may send anything; the tick is 1 ms
Level = Annotated[tuple[str, ...], Few]
Order = Annotated[tuple[str | Level, ...], Few]
Names = str | Level
Seconds = Annotated[float, Field(strict=True, ge=0)]


class ChangeRequest(Settings):
    """One change of priorities: one of set, order, insert and remove."""

    over_s: Seconds = Field(0.0, description="duration of the transition, (15) [s]; 0: at once")
    set: Annotated[tuple[Entry, ...], Few] = Field(
        (), description="[A, B, alpha]: how much A is kept out of B; B out of A becomes 1 − alpha"
    )
    order: Order = Field((), description="tasks, highest first; the pairs among them change")
    insert: Names = Field((), description="tasks that take part again, with their priorities")
    remove: Names = Field((), description="tasks that no longer take part")

    @model_validator(mode="after")
    def _one_change(self) -> Self:
        if sum(map(bool, (self.set, self.order, self.insert, self.remove))) != 1:
            raise ValueError("should have one of set, order, insert and remove")
        if self.order and sum(1 if isinstance(each, str) else len(each) for each in self.order) < 2:
            raise ValueError("should order two tasks or more")
        return self


class ChangeSettings(ChangeRequest):
    """A change of the timeline."""

    at_s: Seconds = Field(description="its begin, since the controller's [s]")


class PrioritySettings(Settings):
    """Priorities at the start, by `order` or by `matrix`, and how they change."""

    order: Order = Field(
        (), description="all tasks, highest first; those of an inner list at one level"
    )
    matrix: tuple[tuple[Alpha, ...], ...] = Field(
        (), description="instead: row i, column j: priority of task j over task i, 0 to 1"
    )
    inactive: tuple[str, ...] = Field((), description="tasks that take no part at the start")
    timeline: tuple[ChangeSettings, ...] = Field(
        (), description="changes, in any order; those of one pair may not overlap"
    )

    @model_validator(mode="after")
    def _one_start(self) -> Self:
        if self.order and self.matrix:
            raise ValueError("should have either order or matrix")
        if self.order == () and "order" in self.model_fields_set:
            raise ValueError("should name every task in order, or have no order")
        return self
