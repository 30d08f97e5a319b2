"""What a solver's kernel says of its work.

Kernels take these numbers as constants, so this file counts as one of their sources.
"""

from __future__ import annotations

OK = 0
INFEASIBLE = 1
BAD_INPUT = 2
BAD_SHAPE = 3
OUT_OF_RANGE = 4

NAMES = ("ok", "infeasible", "bad_input", "bad_shape", "out_of_range")
