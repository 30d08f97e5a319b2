"""`axes` of `frame_position`: some components of a place, the others left free."""

from __future__ import annotations

import numpy as np
import pytest
from task_cases import CIRCLE, HAND, HOAP3, kinematics_of

from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.tasks.registry import TaskSettings, build, check_parameters
from hoap3.testing import posture


def made(**parameters):
    settings = TaskSettings(
        task="frame_position", parameters={**HAND, "target": CIRCLE, **parameters}
    )
    function, kinematics = build(settings, HOAP3, kinematics_of("hoap3")), kinematics_of("hoap3")
    kinematics.update(np.array(HOAP3.initial_position))
    function.reset(kinematics, 0.0)
    kinematics.update(posture(HOAP3, 4))
    function.update(kinematics, 0.7)
    return function


@pytest.mark.parametrize(("axes", "rows"), [("y", [1]), ("zx", [2, 0]), ("yzx", [1, 2, 0])])
def test_a_task_of_some_axes_has_those_rows_of_the_whole(axes, rows):
    whole, some = made(), made(axes=list(axes))
    assert len(some.error) == len(axes)
    np.testing.assert_array_equal(some.error, whole.error[rows])
    np.testing.assert_array_equal(some.jacobian, whole.jacobian[rows])
    np.testing.assert_array_equal(some.error_rate, whole.error_rate[rows])
    assert np.abs(some.error_rate).max() > 1e-3
    assert some.value == pytest.approx(0.5 * float(some.error @ some.error), rel=1e-12)


@pytest.mark.parametrize("axes", [[], ["x", "x"], ["w"]])
def test_axes_that_say_nothing_are_refused(axes):
    settings = TaskSettings(
        task="frame_position", parameters={**HAND, "target": CIRCLE, "axes": axes}
    )
    with pytest.raises(ConfigError) as caught:
        check_parameters(settings)
    assert "parameters.axes" in caught.value.key
