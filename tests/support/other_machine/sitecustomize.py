"""On PYTHONPATH, it lets processes of ours see another machine than this one.

`FAKE_CPUS`: the folder that stands for /sys/devices/system/cpu, on a machine that seems to grant
every right to real time and changes nothing. `MOST_BYTES`: of a file that an observer writes.
"""

from __future__ import annotations

import os
import resource
import sys
from pathlib import Path

if "FAKE_CPUS" in os.environ:
    import hoap3.tools.machine.cpu_idle

    os.sched_setaffinity = os.sched_setscheduler = lambda *_: None
    hoap3.tools.machine.cpu_idle.SYSTEM = Path(os.environ["FAKE_CPUS"])
if "MOST_BYTES" in os.environ and "hoap3.tools.services.observer" in sys.orig_argv:
    most = int(os.environ["MOST_BYTES"])
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
