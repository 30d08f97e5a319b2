"""Asks for real time in a process of its own and prints, as JSON, what it got.

realtime_child.py prepare SETTINGS [UID]   measures of `prepare_process`, perhaps as that user
realtime_child.py claim CPU                claim a CPU, print its number, hold it until the end
"""

from __future__ import annotations

import gc
import json
import os
import resource
import sys

from hoap3.protocol.config.settings import RealtimeSettings
from hoap3.protocol.runtime.realtime import claim_cpu, prepare_process


def become(user: str) -> None:
    """Be that user, without any right to real time."""
    for limit in (resource.RLIMIT_RTPRIO, resource.RLIMIT_MEMLOCK):
        resource.setrlimit(limit, (0, 0))
    os.setgroups([])
    os.setgid(int(user))
    os.setuid(int(user))


def prepare(settings: str) -> None:
    before = os.sched_getaffinity(0)
    measures = prepare_process(RealtimeSettings(**json.loads(settings)))
    report = {
        "measures": {measure.name: [measure.obtained, str(measure)] for measure in measures},
        "affinity": sorted(os.sched_getaffinity(0)),
        "affinity_before": sorted(before),
        "policy": os.sched_getscheduler(0),
        "priority": os.sched_getparam(0).sched_priority,
        "rttime": resource.getrlimit(resource.RLIMIT_RTTIME)[0],
        "collector": gc.isenabled(),
        "switch_interval": sys.getswitchinterval(),
    }
    print(json.dumps(report))


def claim(cpu: str) -> None:
    claimed = claim_cpu({int(cpu)})
    print(claimed.cpu if claimed else None, flush=True)
    sys.stdin.read()


if __name__ == "__main__":
    action, argument, *user = sys.argv[1:]
    if user:
        become(*user)
    {"prepare": prepare, "claim": claim}[action](argument)
