"""What `hoap3 verify` prints."""

from __future__ import annotations

from collections.abc import Iterator

from hoap3.tools.verify.verify import Verification

MOST_SHOWN = 10  # false claims that are printed one by one; --json has more


def shown(found: Verification) -> Iterator[str]:
    """A verdict, a table of claims, the first false ones, and what could not be verified."""
    claims = found.claims
    rest = f"; {claims.unverifiable} could not be recomputed" if claims.unverifiable else ""
    yield f"{found.verdict}: {claims.checked} numbers recomputed, {claims.false} false{rest}"
    yield f"{'claim':<28}{'checked':>10}{'false':>8}{'first tick':>12}{'worst / tolerance':>20}"
    for name, count in sorted(claims.counts.items()):
        if count.checked:
            first = "" if count.first_false is None else str(count.first_false)
            worst = f"{count.largest:.2g}"
            yield f"{name:<28}{count.checked:>10}{count.false:>8}{first:>12}{worst:>20}"
    for one in claims.by_tick()[:MOST_SHOWN]:
        yield (
            f"tick {one.tick}: {one.claim} {one.stated:.17g} where {one.found:.17g} "
            f"is found (tolerance {one.tolerance:.2g})"
        )
    if claims.left_out:
        sample = claims.answers - claims.left_out
        yield (
            f"certificates: {sample} of {claims.answers} answers were recomputed, a random sample; "
            "--all recomputes every one"
        )
    if found.missing:
        yield f"not verified: a part of the log is missing: {found.missing}"
    for name, count in sorted(claims.counts.items()):
        for reason, cycles in count.unverified.items():
            yield f"not verified: {name}, {cycles} times: {reason}"
