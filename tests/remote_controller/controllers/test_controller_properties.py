"""Every shipped config has what every controller must have."""

from __future__ import annotations

import pytest

from hoap3.remote_controller.config import available_configs
from hoap3.testing import ControllerProperties


class TestShipped(ControllerProperties):
    cases = available_configs()
    resting = ("steered_ur5",)
    slow, long = pytest.mark.slow, pytest.mark.long
