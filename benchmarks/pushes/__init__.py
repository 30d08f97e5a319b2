"""How hard a standing robot may be pushed: `python -m benchmarks.pushes`.

`capture` has the bounds, `trials` the pushes.
"""
