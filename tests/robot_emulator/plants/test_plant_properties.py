"""Every plant that we ship, and each of its ways, has what every plant must have."""

from __future__ import annotations

import bad_plants
import pytest

from hoap3.robot_emulator.config import available_configs
from hoap3.robot_emulator.plants.registry import BUILTIN, USUAL
from hoap3.testing import PlantCase, PlantProperties

WAYS = (
    {"robot": "hoap3", "plant": {"servo": "lag"}},
    {"robot": "hoap3", "plant": {"encoder": "counts"}},
    {"robot": "lwr", "command": "acceleration"},
    {"robot": "lwr", "command": "torque"},
    *(
        {"robot": "lwr", "command": kind, "plant": {"kind": "mujoco"}}
        for kind in ("position", "torque")
    ),
)


class TestShipped(PlantProperties):
    cases = (*WAYS, *available_configs())

    def test_every_plant_of_ours_is_tried(self):
        configs = [PlantCase(case).config for case in self.cases]
        tried = {each.plant.kind or USUAL[each.command or "position"] for each in configs}
        assert tried == set(BUILTIN)


FAULTS = {
    "Faultless": set(),
    "Renewer": {"arrays_are_as_declared"},
    "Sharer": {"arrays_are_as_declared", "keeps_no_hold"},
    "Drifter": {"starts_at_rest", "reset_forgets"},
    "Keeper": {"keeps_no_hold"},
    "Meddler": {"keeps_no_hold"},
    "Grower": {"everything_is_finite"},
    "Gambler": {"same_commands", "repeats_bit_by_bit"},
    "Grudger": {"reset_forgets"},
}


@pytest.mark.filterwarnings("ignore:overflow:RuntimeWarning", "ignore:invalid:RuntimeWarning")
@pytest.mark.parametrize("name", FAULTS)
def test_the_suite_finds_the_fault(name):
    assert hasattr(bad_plants, name)
    case = PlantCase({"robot": "ur5", "plant": {"kind": f"bad_plants:{name}"}})
    failed = set()
    for test in (each for each in dir(PlantProperties) if each.startswith("test_")):
        try:
            getattr(PlantProperties(), test)(case)
        except AssertionError:
            failed.add(test)
    assert bool(failed) == bool(FAULTS[name]), failed
    for fault in FAULTS[name]:
        assert any(fault in test for test in failed), (fault, failed)
