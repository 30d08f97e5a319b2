"""The robot's authority, searched: nothing wrong as it is, and every planted fault found."""

from __future__ import annotations

import pytest

from .authority.mutants import MUTANTS, search_with
from .authority.proof import prove_authority
from .authority.search import search


def test_nothing_is_wrong_in_a_small_world():
    found = search(2, 2, 0)
    assert (found.wrong, found.story) == ("", ())
    assert found.worlds > 100


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.what)
def test_a_planted_fault_is_found_with_the_story_that_leads_there(mutant):
    before = vars(mutant.owner)[mutant.name]
    found = search_with(mutant)
    assert found.wrong
    assert found.story
    assert vars(mutant.owner)[mutant.name] is before


def test_a_fault_that_is_not_found_fails_the_proof():
    proof = prove_authority(1, 0, 0, faults=False)
    assert proof.holds
    proof.fault("a fault", "")
    assert not proof.holds
    assert proof.as_json()["faults"]["missed"] == ["a fault"]


@pytest.mark.slow
def test_nothing_is_wrong_with_three_clients():
    assert not search(3, 3, 1).wrong


@pytest.mark.long
def test_nothing_is_wrong_in_six_requests_and_two_crashes():
    proof = prove_authority()
    assert proof.holds
    assert len(proof.found) >= 10
