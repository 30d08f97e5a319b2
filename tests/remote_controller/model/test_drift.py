"""J̇·dq of frames and of the centre of mass, against differences of J·dq."""

from __future__ import annotations

import numpy as np
import pytest
from support.constraint_bench import ROBOTS, posture

from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.model.motion import Motion

FRAMES = {"hoap3": ("l_forearm", "r_sole", "head"), "small": ("hand", "base", "fore")}


def moving(name, seed):
    robot = ROBOTS[name]()
    motion = Motion(robot, Kinematics(robot))
    dq = np.random.default_rng(seed).normal(0.0, 2.0, robot.n)
    motion.update(posture(robot, seed), dq)
    return motion


def differences(motion, rates):
    ahead, behind, apart = motion.aside()
    return (rates(ahead) - rates(behind)) / apart


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("seed", range(10))
def test_a_frame_seen_from_any_other_accelerates_so(name, seed):
    motion = moving(name, seed)
    for frame in FRAMES[name]:
        for reference in FRAMES[name]:
            ids = [motion.kinematics.frame_id(which) for which in (frame, reference)]

            def rates(kinematics, ids=ids):
                jacobian = np.zeros((6, len(motion.q)))
                kinematics.frame(*ids, np.zeros(3), np.zeros((3, 3)), jacobian)
                return jacobian @ motion.dq

            drift = np.full(6, np.nan)
            motion.frame_drift(*ids, drift)
            expected = differences(motion, rates)
            np.testing.assert_allclose(drift, expected, rtol=0, atol=1e-8 * motion.dq @ motion.dq)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("seed", range(10))
def test_the_centre_of_mass_accelerates_so_and_stays_where_it_is(name, seed):
    motion = moving(name, seed)
    for reference in FRAMES[name]:
        frame = motion.kinematics.frame_id(reference)

        def rates(kinematics, frame=frame):
            jacobian = np.zeros((3, len(motion.q)))
            kinematics.com(frame, np.zeros(3), jacobian)
            return jacobian @ motion.dq

        before = rates(motion.kinematics)
        drift = np.full(3, np.nan)
        motion.com_drift(frame, drift)
        np.testing.assert_allclose(rates(motion.kinematics), before, atol=1e-14)
        expected = differences(motion, rates)
        np.testing.assert_allclose(drift, expected, rtol=0, atol=1e-8 * motion.dq @ motion.dq)


def test_at_rest_nothing_is_looked_at_aside():
    motion = moving("small", 0)
    motion.update(motion.q.copy(), np.zeros(3))
    assert not motion.moves
    ahead, behind, _ = motion.aside()
    for kinematics in (ahead, behind):
        at = np.zeros(3)
        kinematics.joints(at)
        np.testing.assert_array_equal(at, motion.q)
