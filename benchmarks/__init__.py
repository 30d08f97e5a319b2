"""Benchmarks and generators that maintainers run from a checkout: `python -m benchmarks.NAME`."""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # read once, when numpy is imported
