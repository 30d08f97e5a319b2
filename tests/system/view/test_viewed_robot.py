"""The live page's server with a robot that runs: what it shows, who moves it, and letting go."""

from __future__ import annotations

import json
import os
import signal
import time

import numpy as np
import pinocchio as pin
import pytest
from support.command_bench import Command, endpoint, tell, wait_for_mode
from support.pages.steered_arm import (
    FAR,
    HOME,
    ROBOT,
    address,
    dragging,
    goes_to,
    hand,
    steer,
    tool,
    until_rest,
)
from support.pages.view_bench import page
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from hoap3.protocol.errors import UsageError
from hoap3.protocol.link import zenoh_session as network
from hoap3.protocol.messages import State
from hoap3.tools.services.client import client_settings

pytestmark = pytest.mark.slow


def test_a_frame_is_forward_kinematics_of_the_state_that_it_names(home, host, token, robot):
    with page(host, token) as pen:
        places = {link["name"]: i for i, link in enumerate(pen.hello["links"])}
        steer(pen)
        assert pen.act(verb="target", name="hand", values=FAR)["error"] is None
        seen = {}
        for _ in range(60):
            pen.beat()
            frame = pen.wait_for("frame")
            seen[frame["tick"]] = frame
        assert pen.act(verb="drop")["error"] is None
        pen.act(verb="release")
    assert len(seen) > 50
    for frame in seen.values():
        pose = pin.XYZQUATToSE3(np.array(frame["poses"][places["tool0"]]))
        assert np.abs(pose.homogeneous - tool(np.array(frame["q"]))).max() < 1e-5
        assert np.allclose(frame["targets"][0], pose.translation, atol=2e-6)


def test_a_frame_has_the_q_of_the_state_of_its_tick(home, host, at):
    payloads = []
    with network.open_session(client_settings(at)) as session, page(host) as pen:
        listener = session.declare_subscriber(
            network.state_key(ROBOT), lambda sample: payloads.append(bytes(sample.payload))
        )
        frames = [pen.wait_for("frame") for _ in range(40)]
        listener.undeclare()
    states = {}
    for payload in payloads:
        state = State.like(payload)
        state.load(payload)
        states[state.tick] = state
    pairs = [(each, states[each["tick"]]) for each in frames if each["tick"] in states]
    assert len(pairs) > 20  # it may show some from before we listened
    for frame, state in pairs:
        assert np.allclose(frame["q"], state.q, atol=1e-6)
        assert frame["stamp_ns"] == state.stamp_published


def test_a_greeting_tells_what_can_be_steered_and_changed(host):
    with page(host) as pen:
        (target,) = pen.hello["targets"]
        found = target["name"], target["kind"], target["frame"], target["reference"]
        assert found == ("hand", "frame_position", "tool0", "base")
        keys = {each["key"]: each for each in pen.hello["changeable"]}
        assert keys["tasks.hand.gain_per_s"]["value"] == 10.0
        assert keys["tasks.hand.gain_per_s"]["lower"] == 0.0
        assert "ghc_velocity" in pen.hello["config"]
        frame = pen.wait_for("frame")
        assert frame["mode"] == "active"
        assert frame["frames"][0]["name"] == "hand"
        assert frame["values"]["success_rate"] is not None


def test_a_drag_moves_the_tool_there(home, host, token, robot):
    with page(host, token) as pen:
        steer(pen)
        assert pen.wait_for("frame", operator="me")
        goes_to(robot, pen, FAR)
        goes_to(robot, pen, HOME)
        pen.act(verb="release")
        assert pen.wait_for("frame", operator="none")


@pytest.mark.long  # it needs the machine for itself
def test_a_velocity_moves_the_tool_along(home, host, token, robot):
    before = hand(robot.state())
    with page(host, token) as pen:
        steer(pen)
        began = time.monotonic()
        while (moved := hand(robot.state()) - before)[1] < 0.03:
            word = pen.act(verb="velocity", name="hand", values=[0.0, 0.1, 0.0])
            assert word["error"] is None
            pen.wait_for("frame")
            pen.wait_for("frame")
        drove_s = time.monotonic() - began
        pen.act(verb="drop")
        pen.act(verb="release")
    assert moved[1] < 0.1 * drove_s
    assert np.abs(moved[[0, 2]]).max() < 5e-3


def test_a_number_is_changed_and_all_pages_are_told(home, host, token):
    with page(host) as other, page(host, token) as pen:
        assert pen.prove()
        key = "tasks.hand.gain_per_s"
        assert pen.act(verb="change", what={key: 12.0}, over_s=0.01)["error"] is None
        value = 10.0
        while value != 12.0:  # soon after the change, or when all is asked for again
            told = other.wait_for("changed")
            value = {each["key"]: each["value"] for each in told["changeable"]}[key]
        assert pen.act(verb="change", what={key: -1.0})["error"]
        pen.act(verb="change", what={key: 10.0}, over_s=0.01)


def test_stop_stops_and_recover_lets_it_move_again(home, host, token, at):
    with page(host, token) as pen:
        assert pen.prove()
        assert pen.act(verb="stop")["error"] is None
        wait_for_mode("stopped", at, ROBOT)
        assert pen.wait_for("frame", mode="stopped")
        assert pen.act(verb="recover")["error"] is None
        wait_for_mode("active", at, ROBOT)
        assert pen.act(verb="recover")["error"]  # it is not stopped


def test_after_a_stop_while_a_page_drags_others_may_steer(home, host, token, robot, at):
    with page(host, token) as pen:
        steer(pen)
        assert pen.act(verb="target", name="hand", values=FAR)["error"] is None
        assert pen.act(verb="stop")["error"] is None
        wait_for_mode("stopped", at, ROBOT)
        pen.act(verb="target", name="hand", values=HOME)  # it drags on
        pen.wait_for("frame", operator="none")
        for _ in range(300):
            try:
                robot.acquire(timeout_s=-1.0)
            except UsageError:
                pen.wait_for("frame")
            else:
                break
        else:
            pytest.fail("the page has gone, and its lease is kept")
    robot.release()


def test_who_does_not_know_the_token_moves_nothing(home, host, token, robot, at):
    """Foreign origin and host, no token, a wrong one, and one of another connection."""
    port = host.rpartition(":")[2]
    with pytest.raises(InvalidStatus):
        connect(f"ws://{host}/socket", origin="http://evil.example")
    with pytest.raises(InvalidStatus):
        connect(
            f"ws://{host}/socket",
            origin=f"http://evil.example:{port}",
            additional_headers={"Host": f"evil.example:{port}"},
        )
    deeds = [
        {"verb": "acquire"},
        {"verb": "target", "name": "hand", "values": FAR},
        {"verb": "velocity", "name": "hand", "values": [0.1, 0.1, 0.1]},
        {"verb": "change", "what": {"tasks.hand.gain_per_s": 5.0}},
        {"verb": "stop"},
    ]
    before = hand(robot.state())
    with page(host, token) as known:
        proof = {"kind": "prove", "proof": known.code(known.nonce + known.origin)}
        recorded = []
        for number, do in enumerate(deeds, 1):
            text = json.dumps(do)
            recorded.append(
                {"kind": "act", "id": number, "mac": known.mac(number, text), "do": text}
            )
    with page(host) as missing, page(host, "x" * 32) as wrong, page(host) as replayed:
        for pen in (missing, wrong):
            pen.prove()
            for do in deeds:
                assert pen.act(**do)["error"]
        replayed.say(**proof)
        assert not replayed.wait_for("proved")["ok"]
        for word in recorded:
            replayed.say(**word)
            assert replayed.wait_for("told", id=word["id"])["error"]
        for _ in range(15):
            frame = missing.wait_for("frame")
    assert frame["operator"] == "none"
    assert tell("status", at, ROBOT)["mode"] == "active"
    assert np.linalg.norm(hand(robot.state()) - before) < 1e-4
    assert robot.changeable()["tasks"]["hand"]["gain_per_s"] == 10.0


def test_two_programs_do_not_steer_at_once(home, host, token, robot):
    robot.acquire(timeout_s=10.0)
    with page(host, token) as pen:
        assert pen.prove()
        assert robot.who in pen.act(verb="acquire")["error"]
        robot.release()
        steer(pen)
        pen.act(verb="release")


def test_without_steering_pages_only_look(viewed, at):
    words = ("view", ROBOT, "--connect", at, "--port", "0", "--no-steering")
    with Command(*words) as command:
        for _ in range(3000):
            if "http://" in command.stdout:
                break
            assert not command.ended_within(0.02), command.stderr
        url = command.stdout.strip()
        assert "#" not in url
        with page(url.removeprefix("http://").rstrip("/")) as pen:
            assert not pen.hello["writes"]
            assert pen.wait_for("frame")
        assert command.end(signal.SIGTERM) == 0
        assert "Traceback" not in command.stderr


def test_its_end_lets_go_of_the_robot(home, at, robot):
    with Command("view", ROBOT, "--connect", at, "--port", "0") as command:
        own_host, own_token = address(command)
        with page(own_host, own_token) as pen:
            steer(pen)
            pen.act(verb="target", name="hand", values=FAR)
            pen.beat()
            assert command.end(signal.SIGINT) == 0
        assert "Traceback" not in command.stderr
    robot.acquire()
    robot.release()
    assert np.linalg.norm(hand(robot.state()) - FAR) > 0.05


def test_a_robot_that_is_not_there_is_said_to_be():
    with Command("view", ROBOT, "--connect", endpoint(), "--port", "0") as command:
        assert command.end() == 1
        assert "nothing answers" in command.stderr


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_a_page_that_freezes_or_is_killed_while_it_drags_lets_go(number, home, host, token, robot):
    with dragging(host, token, FAR) as process:
        os.kill(process.pid, number)
        since = robot.state()
        took, place = until_rest(robot, since)
        print(f"{number.name}: at rest after {took:.3f} s")
        assert np.linalg.norm(place - FAR) > 0.05  # it did not go on to where it was dragged
        with page(host, token) as pen:
            steer(pen)
            free = robot.state().tick - since.tick
            print(f"the next page steers after {free} ticks")
            pen.act(verb="release")


def test_a_page_that_is_closed_while_it_drags_lets_go(home, host, token, robot):
    with page(host, token) as pen:
        steer(pen)
        pen.act(verb="target", name="hand", values=FAR)
        for _ in range(15):  # half a second: it moves
            pen.beat()
            pen.wait_for("frame")
        since = robot.state()
    took, place = until_rest(robot, since)
    print(f"closed: at rest after {took:.3f} s")
    assert np.linalg.norm(place - FAR) > 0.05
