"""docs/guides/controllers.md: its fragments run, and what it says in figures is so."""

from __future__ import annotations

import copy

import numpy as np
import pytest
import yaml
from pages import blocks

from hoap3.remote_controller.controllers.base import STATUS
from hoap3.tools.services.simulate import simulate

PAGE = "controllers.md"
FRAGMENTS = [b for b in blocks(PAGE) if (b.word, b.rest) == ("fragment", "lift.yaml")]
WHOLE = next(b for b in blocks(PAGE) if (b.word, b.rest) == ("file", "lift.yaml"))


@pytest.mark.parametrize("fragment", FRAGMENTS, ids=lambda each: f"line {each.line}")
def test_priorities_of_the_page_run(fragment):
    config = yaml.safe_load(WHOLE.text)
    config["parameters"]["priorities"] = yaml.safe_load(fragment.text)
    run = simulate("hoap3", config, duration=0.02)
    assert set(run.setpoints["solver_status"]) <= {STATUS["certified"], STATUS["uncertified"]}
    assert (run.setpoints["fallback"] == 0).all()


def shipped(**parameters):
    from hoap3.protocol.config.settings import load_yaml
    from hoap3.remote_controller.config import CONFIGS

    config = copy.deepcopy(load_yaml(CONFIGS / "ghc_velocity.yaml"))
    config["parameters"].update(parameters)
    return simulate("hoap3", config, 4.0)


def test_at_a_bound_the_error_of_the_centre_of_mass_grows_with_the_regularisation():
    tight, loose = (shipped(regularisation=w) for w in (1e-6, 1e-4))
    waist = tight.controller.description.joint_names.index("waist_pitch")
    assert np.abs(tight.states["reference"][:, waist]).max() < 1e-6
    off = [run.setpoints["extra"][-1, 0] for run in (tight, loose)]
    assert off[0] < 1e-6
    assert 30.0 < off[1] / off[0] < 300.0
