"""Processes below a process, and what they hold."""

from __future__ import annotations

import os
import subprocess
import sys

from hoap3.tools.bench.soak.watch import descendants, holdings, name_of

CHILD = """if True:
    import subprocess, sys, threading
    inner = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    held = []
    def read(): return sys.stdin.readline()
    print(inner.pid, flush=True)
    read()
    held += [open("/dev/null") for _ in range(5)]
    wait = threading.Event()
    thread = threading.Thread(target=wait.wait)
    thread.start()
    held.append(bytes(range(256)) * 80_000)  # 20 MB
    print("grown", flush=True)
    read()
    wait.set()
    inner.communicate(b"\\n")
"""


def test_what_a_process_holds_and_who_is_below_it():
    words = [sys.executable, "-c", CHILD]
    pipe = subprocess.PIPE
    with subprocess.Popen(words, stdin=pipe, stdout=pipe, text=True) as child:
        inner = int(child.stdout.readline())
        found = descendants(os.getpid())
        assert found[child.pid] == os.getpid()
        assert found[inner] == child.pid
        assert list(found).index(child.pid) < list(found).index(inner)
        assert os.getpid() not in found
        before = holdings(child.pid)
        child.stdin.write("\n")
        child.stdin.flush()
        assert child.stdout.readline() == "grown\n"
        after = holdings(child.pid)
        assert after["descriptors"] == before["descriptors"] + 5
        assert after["threads"] == before["threads"] + 1
        assert after["rss_bytes"] - before["rss_bytes"] > 15_000_000
        child.communicate("\n")
    assert child.returncode == 0
    assert holdings(child.pid) is None
    assert name_of(child.pid, "?") == f"process {child.pid}"


def test_what_has_ended_and_is_not_waited_for_holds_nothing():
    with subprocess.Popen([sys.executable, "-c", ""]) as child:
        os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)
        assert holdings(child.pid) is None
