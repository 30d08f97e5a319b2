"""Timing of calls: every single one, and in batches as the paper's tool does."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from typing import Any

import numpy as np

BATCH = 10


def time_calls(call: Callable[[int], object], samples: int, warm_up: int = 200) -> dict[str, Any]:
    """Time `call(k)` for k = 0, 1 …, each on its own and then in batches of ten.

    The cost of reading the clock, some 0.1 us, is part of single calls and a tenth of that in
    batches. Garbage collection is off meanwhile. The maximum belongs to the machine, not to the
    code: look at the median and p99.

    Returns:
        min, mean, p50, p99, max of single calls; least, median and greatest of the batches' means;
        all in us; `samples` single calls.
    """
    for k in range(warm_up):
        call(k)
    now = time.perf_counter_ns
    single = np.zeros(samples, np.int64)
    batches = np.zeros(max(1, samples // BATCH), np.int64)
    enabled = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        for k in range(samples):
            start = now()
            call(k)
            single[k] = now() - start
        for batch in range(batches.size):
            first = batch * BATCH
            start = now()
            for k in range(first, first + BATCH):
                call(k)
            batches[batch] = now() - start
    finally:
        if enabled:
            gc.enable()
    us = single / 1e3
    return {
        "samples": samples,
        "min_us": float(us.min()),
        "mean_us": float(us.mean()),
        "p50_us": float(np.percentile(us, 50)),
        "p99_us": float(np.percentile(us, 99)),
        "max_us": float(us.max()),
        "batch_min_us": float(batches.min()) / BATCH / 1e3,
        "batch_mean_us": float(np.median(batches)) / BATCH / 1e3,
        "batch_max_us": float(batches.max()) / BATCH / 1e3,
    }
