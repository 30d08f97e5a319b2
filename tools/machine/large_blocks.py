"""Large blocks of memory go back to the system when they are freed."""

from __future__ import annotations

import ctypes

SIZE = 1 << 17  # bytes; where glibc begins
_M_MMAP_THRESHOLD = -3


def give_back_large_blocks() -> None:
    """Have this process map each block of `SIZE` or more on its own, always.

    With each such block that is freed, glibc raises the size from which it does so, up to 32 MB.
    From then on they come from the heap, leave holes, and a process that needs as much as before
    grows all the same. A library without that setting is left alone.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, SIZE)
