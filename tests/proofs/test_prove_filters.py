"""The filters proved: their lemmas, their law in few bits, their compiled code."""

from __future__ import annotations

import numpy as np
import pytest

from .filters import jerk_lemmas, setpoint_lemmas
from .filters.compiled import differing, random_states
from .filters.few_bits import cases, examined, sources
from .filters.mutants import MUTANTS, Mutant, planted
from .filters.proof import SOME, prove_filter, prove_jerk
from .filters.transcribed import transcribed
from .lemmas import Lemma, judged

z3 = pytest.importorskip("z3")


@pytest.mark.parametrize("lemmas", [setpoint_lemmas.lemmas, jerk_lemmas.lemmas])
def test_every_lemma_is_proved(lemmas):
    assert {lemma.name: judged(lemma) for lemma in lemmas() if judged(lemma)} == {}


@pytest.mark.parametrize("lemmas", [setpoint_lemmas.lemmas, jerk_lemmas.lemmas])
def test_an_off_by_one_in_the_law_is_found(lemmas):
    assert any(judged(lemma) for lemma in lemmas(planted=1))


def test_a_lemma_about_nothing_is_none():
    x = z3.Real("x")
    assert judged(Lemma("", (x > 1, x < 0), x > 5))
    assert judged(Lemma("", (x > 1,), x > 5))
    assert not judged(Lemma("", (x > 6,), x > 5))


def test_compiled_code_has_the_bits_of_its_source():
    assert differing(2000) == (2000, 0)


def test_a_fused_product_would_be_seen():
    """Its source with a product rounded but once, together with the sum after it."""
    from fractions import Fraction

    text = "def step(q, w, T):\n    return q + w * T\n"
    plain = transcribed([text], ["step"])["step"]
    rng = np.random.default_rng(1)
    numbers = rng.uniform(-1, 1, (100, 3)).tolist()
    fused = [float(Fraction(q) + Fraction(w) * Fraction(T)) for q, w, T in numbers]
    assert [plain(*row) for row in numbers] != fused


def test_each_operation_is_rounded_and_nothing_else():
    seen: list[float] = []

    def rounded(x):
        seen.append(x)
        return x

    text = "ONE = 1.0\ndef law(x):\n    return max(math.sqrt(x * x), -x) / 2.0 - ONE\n"
    law = transcribed([text], ["law"], rounding=rounded, constants={"ONE": 3.0})["law"]
    assert law(8.0) == 1.0
    assert seen == [64.0, 8.0, 4.0, 1.0]


def test_states_are_within_the_domain():
    limits, (q, v), _, T = random_states(np.random.default_rng(0), 1000)
    lower, upper, speed, acceleration = limits
    assert 1e-4 <= T <= 0.1
    assert np.all((lower <= q) & (q <= upper) & (np.abs(v) <= speed))
    assert np.all(speed / (acceleration * T) <= 2.0**20 * (1.0 + 1e-12))


def test_a_fault_that_is_not_in_the_text_is_an_error():
    with pytest.raises(ValueError, match="nowhere"):
        planted(sources(), Mutant("", "nowhere in the kernels", ""))


def test_the_proof_with_jerk_finds_what_is_planted():
    proof = prove_jerk()
    assert proof.holds
    assert len(proof.found) >= 10


@pytest.mark.slow
@pytest.mark.parametrize("place", cases(11))
def test_the_law_holds_in_some_states_of_eleven_bits(place):
    result = examined(cases(11)[place], 11, stride=SOME)
    assert not result.wrong
    assert result.states > 500


@pytest.mark.slow
@pytest.mark.parametrize("mutant", MUTANTS[:3], ids=lambda mutant: mutant.what)
def test_a_fault_in_the_text_of_the_kernels_is_found(mutant):
    texts = planted(sources(), mutant)
    assert any(examined(case, 11, texts, SOME).wrong for case in cases(11).values())


@pytest.mark.long
def test_the_filter_is_proved_and_all_faults_are_found():
    proof = prove_filter()
    assert proof.holds
    assert len(proof.found) >= 10
