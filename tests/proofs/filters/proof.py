"""The proofs of the filters of positions: without, and with, a limit of jerk."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ..claims import Proof
from ..lemmas import Lemmas, judged, refuted

Tell = Callable[[str], None]

FINE, SOME = 11, 397
"""Bits in which every so many velocities are looked at, and planted faults are looked for: with 8,
the reserve for rounding is so large that it covers some of them."""


def prove_filter(
    bits: int = 8, states: int = 1_000_000, *, faults: bool = True, tell: Tell | None = None
) -> Proof:
    """The setpoint filter: its lemmas, its law in few bits, its compiled code.

    Args:
        bits: how precise the exhaustive run is.
        states: how many are compared with strict arithmetic.
        faults: whether planted faults are looked for, too.
        tell: is told what is looked at.
    """
    from .compiled import differing
    from .few_bits import cases, examined, sources
    from .mutants import look_for
    from .setpoint_lemmas import lemmas

    proof, told = Proof("setpoint filter"), tell or _silent
    _prove(proof, lemmas, told, faults=faults)
    for precise, stride in ((bits, 1), (FINE, SOME)):
        some = "" if stride == 1 else f", every {stride}th velocity"
        for place, case in cases(precise).items():
            told(f"{precise} bits, {place}")
            result = examined(case, precise, stride=stride)
            size = f"{result.looked_at} transitions from {result.states} states"
            name = f"law in {precise} bits, {place}{some}"
            proof.note(name, not result.wrong, result.wrong or size)
    told("compiled code")
    run, wrong = differing(states)
    detail = f"{wrong} of {run} states come out with other bits"
    proof.note("compiled code is strict IEEE", not wrong, detail)
    if faults:

        def look(texts: Sequence[str]) -> str:
            found = (examined(case, FINE, texts, SOME).wrong for case in cases(FINE).values())
            return next((wrong for wrong in found if wrong), "")

        def note(what: str, wrong: str) -> None:
            told(what)
            proof.fault(what, wrong)

        look_for(sources(), look, note)
    return proof


def prove_jerk(*, faults: bool = True, tell: Tell | None = None) -> Proof:
    """The lemmas of the filter with a limit of jerk; see `prove_filter`."""
    from .jerk_lemmas import lemmas

    proof = Proof("filter with a limit of jerk")
    _prove(proof, lemmas, tell or _silent, faults=faults)
    return proof


def _prove(proof: Proof, lemmas: Lemmas, told: Tell, *, faults: bool) -> None:
    for lemma in lemmas():
        told(lemma.name)
        wrong = judged(lemma)
        proof.note(lemma.name, not wrong, wrong or "proved")
        for i in range(len(lemma.given) if faults else 0):
            less = lemma._replace(given=lemma.given[:i] + lemma.given[i + 1 :])
            proof.fault(f"{lemma.name}: without {lemma.given[i]}", refuted(less))


def _silent(_: str) -> None:
    """Nobody listens."""
