"""Who may command the robot, and what happens when they stop."""

from __future__ import annotations

import numpy as np
import pytest
from support.robot_bench import PERIOD_NS, Bench, active

from hoap3.protocol.messages import State
from hoap3.robot_emulator.loop import REQUESTS_PER_TICK


def test_a_grant_holds_from_its_tick_on_and_the_second_asker_is_told_the_holder():
    bench = Bench(grace=5)
    first = bench.link.ask("acquire", "alice")
    second = bench.link.ask("acquire", "bob")
    bench.run(8)
    assert first[0]["granted"]
    assert (first[0]["epoch"], first[0]["from_tick"]) == (1, 5)
    assert not second[0]["granted"]
    assert second[0]["holder"] == "alice"
    assert [state.mode for state in bench.states()] == [State.IDLE] * 5 + [State.ACTIVE] * 3
    assert {name for name, _, _ in bench.events()} >= {"GRANTED", "REFUSED"}


def test_states_of_a_stopped_robot_tell_of_a_grant_from_tick_0_on():
    """0 would say that there is none, and its holder would give it up."""
    bench = Bench()
    bench.link.ask("stop", "operator")
    answer = bench.link.ask("acquire", "alice")
    state = bench.run(1)
    assert answer[0]["from_tick"] == 0
    assert state.mode == State.STOPPED
    assert state.epoch_from_tick > 0


def test_asking_twice_gives_the_same_grant():
    bench = Bench()
    first, again = bench.link.ask("acquire", "alice"), bench.link.ask("acquire", "alice")
    bench.run(2)
    assert first[0]["epoch"] == again[0]["epoch"]


def test_release_brakes_and_leaves_the_robot_free():
    bench = active("alice")
    bench.speed[:] = 1.0
    bench.run(50)
    bench.link.ask("release", "alice")
    state = bench.run(100)
    assert state.mode == State.IDLE
    assert bench.robot.safe_stops == 0
    reply = bench.link.ask("acquire", "bob")
    assert bench.run(2).mode == State.ACTIVE
    assert reply[0]["epoch"] == 2


def test_the_machines_own_user_takes_authority_from_whoever_holds_it():
    bench = active("alice")
    bench.run(50)
    stranger = bench.link.ask("release", "local")
    assert bench.run(2).mode == State.ACTIVE
    assert not stranger[0]["released"]
    answer = bench.link.ask("release", "local", local=True)
    assert bench.run(100).mode == State.IDLE
    assert answer[0]["released"]
    nobody = bench.link.ask("release", "local", local=True)
    bench.run(1)
    assert not nobody[0]["released"]


def test_a_holder_that_vanishes_is_a_safe_stop():
    bench = active("alice")
    bench.speed[:] = 1.0
    bench.run(50)
    bench.link.ask("gone", "bob")
    assert bench.run(1).mode == State.ACTIVE
    bench.link.ask("gone", "alice")
    state = bench.run(100)
    assert state.mode == State.STOPPED
    assert bench.robot.safe_stops == 1
    bench.link.ask("acquire", "bob")
    assert bench.run(5).mode == State.STOPPED  # latched


def test_recover_resumes_without_a_jump():
    bench = active("alice", grace=5)
    bench.speed[:] = (1.0, -1.0, 2.0)
    bench.run(50)
    bench.link.ask("stop", "operator")
    bench.run(100)
    assert bench.robot.mode == State.STOPPED
    answer = bench.link.ask("recover", "operator")
    bench.speed[:] = 0.0
    bench.run(50)
    assert answer[0]["recovered"]
    assert bench.robot.mode == State.ACTIVE
    reference = np.array([state.reference for state in bench.states()[100:]])
    assert np.ptp(reference, axis=0).max() == 0.0


@pytest.mark.parametrize(
    ("ask", "who", "reason"),
    [("stop", "operator", "command"), ("gone", "alice", "holder_lost")],
)
def test_the_status_says_why_the_robot_is_stopped(ask, who, reason):
    bench = active("alice")
    before = bench.link.ask("status", "operator")
    bench.run(5)
    bench.link.ask(ask, who)
    bench.run(200)
    stopped = bench.link.ask("status", "operator")
    bench.run(1)
    after = bench.link.ask("recover", "operator")
    bench.run(1)
    assert before[0]["stop_reason"] is None
    assert (stopped[0]["mode"], stopped[0]["stop_reason"]) == ("stopped", reason)
    assert after[0]["stop_reason"] is None


def test_the_status_has_the_counts_that_verdicts_rest_on():
    bench = active("alice", misses_to_stop=30)
    bench.run(50)
    bench.oversleep({60: 4 * PERIOD_NS})
    bench.speed[:] = 1e3  # more than a joint can do
    bench.run(50)
    answer = bench.link.ask("status", "operator")
    bench.run(1)
    counts, summary = answer[0]["counts"], bench.robot.summary()
    assert counts["interventions"] > 0
    assert counts["held_back_joints"]["first"] in bench.description.joint_names
    assert (counts["skipped"], counts["misses_to_stop"]) == (4, 30)
    assert counts["asked"] == summary["asked"] - 1  # it was served before the tick was counted
    assert counts.keys() <= summary.keys()


def test_a_stop_holds_also_at_rest_and_before_any_controller():
    bench = Bench()
    bench.link.ask("stop", "operator")
    bench.link.ask("acquire", "alice")
    assert bench.run(5).mode == State.STOPPED
    bench.link.ask("recover", "operator")
    assert bench.run(3).mode == State.ACTIVE


def test_a_release_after_a_stop_does_not_release_the_latch():
    bench = active("alice")
    bench.speed[:] = 1.0
    bench.run(20)
    bench.link.ask("stop", "operator")
    bench.run(2)
    bench.link.ask("release", "alice")
    assert bench.run(100).mode == State.STOPPED


def test_the_run_ends_at_rest_after_its_duration():
    bench = active("alice", grace=3)
    bench.speed[:] = 2.0
    bench.robot.run(0, lambda: False, ticks=100)
    states = bench.states()
    assert sum(state.mode == State.ACTIVE for state in states) == 100
    np.testing.assert_array_equal(states[-1].reference, states[-2].reference)
    assert bench.robot.validator.deadlines.asked == 100
    assert bench.robot.safe_stops == 0
    assert bench.events()[-1][0] == "ENDED"


def test_a_signal_brings_the_robot_to_rest_first():
    bench = active("alice")
    bench.speed[:] = 2.0
    bench.robot.run(0, lambda: bench.clock.now() > 50_000_000)
    states = bench.states()
    assert states[-1].mode == State.STOPPED
    rate = np.diff([state.reference for state in states], axis=0) / 1e-3
    assert np.abs(np.diff(rate, axis=0)).max() <= 2.0 + 1e-9  # the start is the largest step
    np.testing.assert_array_equal(rate[-1], 0.0)


def test_an_answer_to_an_earlier_holder_is_not_followed_under_the_next_one():
    """It was asked for in time, and comes when somebody else drives."""
    late: list[bytes] = []

    def fate(tick, answer):
        if tick == 9:
            late.append(answer)
            return []
        return [] if late else [(1, answer)]

    bench = active("alice", fate=fate, grace=5)
    bench.speed[:] = 1.0
    bench.run(10)
    bench.link.ask("release", "alice")
    bench.run(50)
    bench.link.ask("acquire", "bob")
    bench.run(7)
    assert bench.robot.mode == State.ACTIVE
    before = bench.states()[-1].reference.copy()
    bench.robot.validator.accept(bench.clock.now(), late[0], bench.robot.tick)
    bench.run(3)
    np.testing.assert_array_equal(bench.states()[-1].reference, before)


def test_after_a_recovery_the_holder_is_followed_once_the_grace_period_is_over():
    bench = active("alice", grace=20)
    bench.run(40)
    bench.link.ask("stop", "operator")
    bench.run(10)
    bench.link.ask("recover", "operator")
    recovered = bench.run(1).tick
    bench.run(30)
    ticks = [state.tick for state in bench.states() if state.mode == State.ACTIVE]
    assert min(tick for tick in ticks if tick > recovered) == recovered + 20


def test_no_more_than_some_requests_are_served_in_a_tick():
    bench = Bench()
    bench.robot._requests_per_tick = REQUESTS_PER_TICK  # as in real time
    answers = [bench.link.ask("status", "many") for _ in range(3 * REQUESTS_PER_TICK)]
    bench.run(1)
    assert sum(map(bool, answers)) == REQUESTS_PER_TICK


def test_a_release_in_the_tick_of_the_last_miss_is_a_release():
    bench = Bench(lambda tick, answer: [] if tick >= 50 else [(1000, answer)], misses_to_stop=20)
    bench.link.ask("acquire", "alice")
    bench.speed[:] = 1.0
    bench.run(70)
    bench.link.ask("release", "alice")
    state = bench.run(100)
    assert state.mode == State.IDLE
    assert bench.robot.safe_stops == 0


@pytest.mark.parametrize("policy", ["hold", "extrapolate"])
def test_after_a_recovery_nothing_is_remembered_of_the_motion_before(policy):
    """Also where not one answer comes any more: the old target is not gone on to."""
    lost = {"from": 10**9}
    bench = Bench(
        lambda tick, answer: [] if tick >= lost["from"] else [(1000, answer)],
        loss_policy=policy,
        misses_to_stop=1000,
    )
    bench.link.ask("acquire", "alice")
    bench.speed[:] = 1.0
    bench.run(50)
    bench.link.ask("stop", "operator")
    stopped = bench.run(100)
    assert stopped.epoch == 0
    lost["from"] = stopped.tick
    bench.link.ask("recover", "operator")
    state = bench.run(50)
    assert state.mode == State.ACTIVE
    np.testing.assert_array_equal(state.reference, stopped.reference)


def test_while_another_robot_uses_the_name_nothing_new_is_granted_and_nothing_stops():
    bench = active("alice")
    bench.speed[:] = 1.0
    bench.run(50)
    bench.link.name_conflicts = 1
    own = bench.link.ask("acquire", "alice")
    other = bench.link.ask("acquire", "bob")
    status = bench.link.ask("status", "bob")
    assert bench.run(50).mode == State.ACTIVE
    assert (own[0]["granted"], own[0]["epoch"]) == (True, 1)
    assert (other[0]["granted"], other[0]["reason"]) == (False, "name_taken")
    assert status[0]["name_conflicts"] == 1
    bench.link.ask("release", "alice")
    assert bench.run(100).mode == State.IDLE
    refused = bench.link.ask("acquire", "bob")
    assert bench.run(5).mode == State.IDLE
    assert (refused[0]["granted"], refused[0]["reason"]) == (False, "name_taken")
    bench.link.name_conflicts = 0
    granted = bench.link.ask("acquire", "bob")
    assert bench.run(5).mode == State.ACTIVE
    assert (granted[0]["granted"], granted[0]["epoch"]) == (True, 2)
    conflicts = [detail for name, _, detail in bench.events() if name == "NAME_CONFLICT"]
    assert conflicts == [1, 0]
    assert [detail for name, _, detail in bench.events() if name == "REFUSED"] == [-1, -1]
