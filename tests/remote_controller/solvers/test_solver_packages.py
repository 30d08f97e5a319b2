"""What must be installed for a solver, the error, the docs and the package say alike."""

from __future__ import annotations

import re
import tomllib

import pytest
from support import HOUSE

from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.config import ControllerConfig, build, read_config
from hoap3.remote_controller.controllers.lyapunov_qp.stable_qp import StableQpController
from hoap3.remote_controller.solvers.qp import qp_backends
from hoap3.remote_controller.solvers.sdp import sdp_backends
from hoap3.robot_emulator.robots import load

PROJECT = tomllib.loads((HOUSE / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def named(requirements: list[str]) -> set[str]:
    """Packages of a list of requirements."""
    return {re.split("[<>=]", each)[0] for each in requirements}


OURS = named(PROJECT["dependencies"])
PEERS = {name: each for name, each in qp_backends.PACKAGES.items() if each not in OURS}


def test_an_extra_brings_every_solver_that_does_not_come_by_itself() -> None:
    assert named(PROJECT["optional-dependencies"]["peers"]) == {
        *PEERS.values(),
        *sdp_backends.PACKAGES.values(),
    }


def test_the_setting_says_which_need_installing() -> None:
    said = str(StableQpController.Parameters.model_fields["solver"].description)
    assert all(name in said for name in PEERS)
    assert "hoap3[peers]" in said


@pytest.mark.parametrize(("name", "package"), PEERS.items())
def test_one_that_is_missing_is_said_to_be(
    name: str, package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = qp_backends.find_spec
    monkeypatch.setattr(
        qp_backends, "find_spec", lambda each: (each != package and spec(each)) or None
    )
    shipped = parse(ControllerConfig, read_config("stable_qp_hoap3")[0], "shipped")
    config = shipped.model_copy(update={"parameters": {**shipped.parameters, "solver": name}})
    with pytest.raises(ConfigError) as error:
        build(config, load("hoap3"), "mine.yaml")
    said = str(error.value)
    assert f"{name!r} is known, but not installed: pip install {package}" in said
    assert "parameters.solver" in said
    assert "Did you mean" not in said
