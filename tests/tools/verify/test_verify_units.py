"""`hoap3 verify` recomputes qp12 and stable_qp with the unit of e and the slope of their γ."""

from __future__ import annotations

import pytest
from driven import driven

from hoap3.tools.verify.checkers import checker_of
from hoap3.tools.verify.claims import Claims

CENTIMETRES = {
    "error_unit": "cm",
    "gamma": 0.3,
    "adaptive_gamma": True,
    "gamma_slope": 5e-3,
    "ramp_s": 0.0,
}
SLOPED = {"kind": "qp12", "gamma": 0.3, "adaptive_gamma": True, "gamma_slope": 1e4}


def false_claims(name, run, parameters):
    claims = Claims()
    checker_of(name)(run, parameters, claims)
    assert claims.checked > 0
    return {claim for claim, count in claims.counts.items() if count.false}


@pytest.fixture(scope="module", params=["qp12", "osqp"])
def centimetres(request):
    return request.param, *driven(request.param, "hoap3", 80, **CENTIMETRES)


def test_what_was_answered_in_centimetres_is_true(centimetres):
    assert false_claims(*centimetres) == set()


@pytest.mark.parametrize(
    ("change", "claim"),
    [({"error_unit": "m"}, "required V rate"), ({"gamma_slope": 100.0}, "residual")],
)
def test_another_unit_or_slope_is_found(centimetres, change, claim):
    name, run, parameters = centimetres
    assert claim in false_claims(name, run, {**parameters, **change})


def test_the_slope_of_stable_qp_is_used():
    run, parameters = driven("stable_qp", "hoap3", 80, objective=SLOPED, psi={"form": "one"})
    assert false_claims("stable_qp", run, parameters) == set()
    other = {**parameters, "objective": {**SLOPED, "gamma_slope": 10.0}}
    assert "residual" in false_claims("stable_qp", run, other)
