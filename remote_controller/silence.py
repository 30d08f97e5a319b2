"""Notices that nothing comes any more, for a loop that blocks until something comes."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Self


class SilenceWatch:
    """Wakes a waiting loop once there was no progress for some time, and again each time.

    A thread looks twice in that time, and sleeps in between.

    Args:
        progress: a count that grows with whatever is waited for.
        wake: makes the loop return from its waiting; called in the thread.
        seconds: without progress [s]; noticed after that and at most half of it more.
    """

    def __init__(
        self, progress: Callable[[], int], wake: Callable[[], None], seconds: float
    ) -> None:
        self._progress, self._wake, self._seconds = progress, wake, seconds
        self._ended = threading.Event()
        self._looks = 0  # without progress
        self._silent_at: int | None = None
        self._thread = threading.Thread(target=self._watch, name="silence", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def silent(self) -> bool:
        """Whether it was silent, and still is; asked by the loop when it was woken."""
        at, self._silent_at = self._silent_at, None
        return at == self._progress()

    def reset(self) -> None:
        """Begin to count again: the loop itself was busy."""
        self._looks, self._silent_at = 0, None

    def _watch(self) -> None:
        last = self._progress()
        while not self._ended.wait(self._seconds / 2):
            now = self._progress()
            self._looks = self._looks + 1 if now == last else 0
            last = now
            if self._looks >= 2:
                self._looks, self._silent_at = 0, now
                self._wake()
