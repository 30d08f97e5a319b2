"""What a process frees in large blocks, it does not keep."""

from __future__ import annotations

import subprocess
import sys

import pytest

CHURN = """
from hoap3.tools.machine.processes import give_back_large_blocks

def resident():
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmRSS"))

{call}
del [bytearray(1 << 20)][0]  # freed: glibc takes blocks of this size from the heap from now on
before = resident()
large, small = [], []
for _ in range(40):
    large.append(bytearray(900_000))
    small.append(bytes(2000))  # which stays where it is, above the large one
held = resident()
large.clear()
print(held - before, resident() - before)
"""


@pytest.mark.parametrize("call", ["give_back_large_blocks()", ""])
def test_large_blocks_go_back_only_where_that_is_asked_for(call: str) -> None:
    words = [sys.executable, "-c", CHURN.format(call=call)]
    held, kept = map(int, subprocess.check_output(words, text=True).split())
    assert held > 30_000
    assert (kept < 3_000) == bool(call)
