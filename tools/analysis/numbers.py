"""How a report writes figures: n, percentiles, durations; nothing without its n."""

from __future__ import annotations

from typing import Any

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.deadlines import PERCENTILES, TAIL_SAMPLES, rank

NAMES = {"p50": "p50", "p90": "p90", "p99": "p99", "p99_9": "p99.9", "p99_99": "p99.99"}
"""Keys of a summary, and how people write them."""


def summary(values: Any) -> dict[str, float]:
    """n, min, percentiles and max; the percentile of rank ⌈n·p⌉, as a histogram gives it."""
    sample: FloatArray = np.asarray(values, float)
    sample = sample[np.isfinite(sample)]
    result: dict[str, float] = {"n": len(sample)}
    if not len(sample):
        return result
    shares = dict(PERCENTILES)
    if len(sample) >= TAIL_SAMPLES:
        shares["p99_99"] = 99.99
    ordered = np.sort(sample)
    result["min"] = float(ordered[0])
    for name, share in shares.items():
        result[name] = float(ordered[rank(len(ordered), share) - 1])
    result["max"] = float(ordered[-1])
    return result


def least(values: FloatArray) -> float | None:
    """The smallest finite value; None where there is none."""
    known = values[np.isfinite(values)]
    return float(known.min()) if known.size else None


def greatest(values: FloatArray) -> float | None:
    """The largest finite value; None where there is none."""
    known = values[np.isfinite(values)]
    return float(known.max()) if known.size else None


def number(value: float) -> str:
    """Three significant digits, thousands apart, small ones as 1.2·10⁻⁵."""
    if not np.isfinite(value):
        return "–"
    size = abs(value)
    if size != 0.0 and (size < 1e-3 or size >= 1e7):
        digits, _, power = f"{value:.2e}".partition("e")
        return f"{digits}·10{str(int(power)).translate(_SUPERSCRIPT)}".replace("-", "−", 1)
    decimals = 0 if value == int(value) else max(0, 2 - int(np.floor(np.log10(size))))
    return f"{value:,.{decimals}f}".replace(",", "\N{NARROW NO-BREAK SPACE}").replace("-", "−")


def count(value: int) -> str:
    """A whole number, thousands apart."""
    return f"{value:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def seconds(value: float) -> str:
    """A time [s], to the millisecond."""
    return f"{value:.3f}".replace("-", "−")


def rate(value: float | None) -> str:
    """A success rate as per cent, with as many digits as tell it from 100 %."""
    if value is None:
        return "–"
    return "100 %" if value == 1.0 else f"{100.0 * value:.3f} %"


def spread(figures: dict[str, float], unit: str) -> str:
    """`n 8 000 · min 1 · p50 2 · p99 3 · max 4 µs`, or that there is none."""
    if not figures["n"]:
        return "n 0"
    parts = [f"n {count(int(figures['n']))}", f"min {number(figures['min'])}"]
    parts += [f"{text} {number(figures[key])}" for key, text in NAMES.items() if key in figures]
    return " · ".join([*parts, f"max {number(figures['max'])} {unit}"])


_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
