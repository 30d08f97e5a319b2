"""A reader in a process of its own: says how it goes on standard output, one word a line.

ring_reader.py FD          read until the ring is closed, then print what came
ring_reader.py FD hang     read a little, say so, and never read again
"""

from __future__ import annotations

import json
import sys
import time

from hoap3.protocol.runtime.shm_ring import Kind, Ring


def body(number: int, size: int) -> bytes:
    """Payload that cannot be confused with another one, nor with half of one."""
    word = number.to_bytes(8, "little")
    return word * (size // 8)


def main() -> None:
    ring = Ring(int(sys.argv[1]))
    print("ready", flush=True)
    if sys.argv[2:] == ["hang"]:
        print(len(list(ring.read())), flush=True)
        sys.stdin.read()
        return
    found, gaps, broken = 0, 0, 0
    while True:
        ended = ring.closed
        for record in ring.read():
            if record.kind == Kind.GAP:
                gaps += json.loads(record.payload)["dropped"]
                continue
            broken += record.payload != body(record.stamp, len(record.payload))
            broken += record.stamp < found
            found += 1
        if ended:
            break
        time.sleep(0)  # leave the CPU to the writer, where there is only one
    print(json.dumps({"found": found, "gaps": gaps, "broken": broken}))


if __name__ == "__main__":
    main()
