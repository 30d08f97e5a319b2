"""Every solver of QP12 that is installed agrees with ours; what is not installed is named."""

from __future__ import annotations

import json

import pytest

from benchmarks import qp12_peers, solvers
from benchmarks.qp12_peers import PEERS, installed, missing, peer
from hoap3.protocol.errors import UnknownNameError
from hoap3.tools.bench.solvers import gradients, worst_error

# What each solver's tolerance allows, relative to the largest speed:
EXACT = {"qp12": 1e-12, "daqp": 1e-10, "quadprog": 1e-10}
ERRORS = {**EXACT, "osqp": 1e-3, "osqp_bare": 1e-3, "proxqp": 1e-2}


@pytest.mark.parametrize("gamma", [0.0, 0.5, 0.8])
@pytest.mark.parametrize("name", installed())
def test_a_peer_agrees_with_the_kernel_at_every_call(name, gamma):
    exact, found = peer("qp12", 13, gamma), peer(name, 13, gamma)
    problems = gradients(13)
    assert worst_error(found, exact, problems + problems[::-7]) < ERRORS[name]


def test_an_unknown_peer_is_named():
    with pytest.raises(UnknownNameError, match="daqp"):
        peer("daqpp", 3, 0.5)


@pytest.fixture
def without_quadprog(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(qp12_peers, "OPTIONAL", {"quadprog": "no_such_package"})
    others = {name: make for name, make in PEERS.items() if name != "proxqp"}
    monkeypatch.setattr(qp12_peers, "PEERS", others)


@pytest.mark.slow
@pytest.mark.usefixtures("without_quadprog")
def test_a_solver_that_is_not_installed_is_left_out_and_named(run_command):
    assert missing() == {"quadprog": "no_such_package"}
    done = run_command(solvers.command, "--samples", 10, "--json")
    printed = json.loads(done.stdout)
    assert printed.keys() == {"rows", "general", "missing", "machine"}
    assert "quadprog" in printed["missing"]
    known = {"qp12", "daqp", "osqp", "osqp_bare", "pinv", "pinv_svd", "reference"}
    assert {row["solver"] for row in printed["rows"]} == known
    assert {"daqp", "osqp"} <= {row["solver"] for row in printed["general"]}
    with pytest.raises(UnknownNameError):
        peer("quadprog", 3, 0.5)
    shown = run_command(solvers.command, "--samples", 10).stdout
    assert "pip install no_such_package" in shown
