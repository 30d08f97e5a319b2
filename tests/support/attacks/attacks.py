"""What a stranger, or somebody without the right, tries on a robot; each says if it succeeds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hoap3.protocol.link.zenoh_session import ask, key, open_session, session_name
from hoap3.protocol.messages import Setpoint, State
from support.attacks.attacked_robot import SESSION
from support.attacks.scene import HOLDER, Scene

VICTIMS = 5
TRIES = 20  # of what needs the robot to have heard of something before


def forged(scene: Scene) -> bytes:
    """An answer to the newest State with a position of the attackers', under the holder's epoch."""
    setpoint = Setpoint(3)
    setpoint.session_id, setpoint.tick, setpoint.epoch = SESSION, scene.now.tick, scene.now.epoch
    setpoint.values[:] = 0.01
    return setpoint.dump()


def takes_authority(scene: Scene) -> bool:
    tokens = [
        foe.liveliness().declare_token(key("arm", f"clients/{me}"))
        for me, foe in scene.foes.items()
        if not me.startswith("rival")  # who may, where nobody holds it
    ]
    mine = {me: foe for me, foe in scene.foes.items() if not me.startswith("rival")}
    for me, foe in mine.items():
        for _ in range(TRIES):
            if b'"granted": true' in (scene.during(ask, foe, "arm", "acquire", me) or b""):
                return True
    del tokens
    return False


def releases_in_the_holders_name(scene: Scene) -> bool:
    scene.follow()
    return b'"released": true' in scene.asks("release", HOLDER)


def stops(scene: Scene) -> bool:
    scene.follow()
    scene.asks("stop")
    return scene.now.mode != State.ACTIVE


def recovers(scene: Scene) -> bool:
    scene.follow()
    scene.robot.stop()
    scene.wait(lambda: scene.now.mode == State.STOPPED)
    return b'"recovered": true' in scene.asks("recover")


def injects_setpoints(scene: Scene) -> bool:
    scene.follow()
    before = scene.now.newest_tick
    for leaf in (f"setpoint/{HOLDER}", "setpoint/{me}", "setpoint"):
        scene.put(leaf, forged(scene))
    scene.step()
    return scene.now.newest_tick > before


def feigns_states(scene: Scene) -> bool:
    scene.follow()
    scene.put("state/2", b"feigned")
    while (sample := scene.states.try_recv()) is not None:
        if sample.payload.to_bytes() == b"feigned":
            return True
    return False


def feigns_descriptions(scene: Scene) -> bool:
    heard: list[str] = []

    def feign(query: Any) -> None:
        heard.append(str(query.key_expr))
        query.reply(query.key_expr, b"feigned")

    for settings in scene.settings:  # as peers, whom a robot passes a client's questions on to
        foe = scene.keep(open_session(settings.model_copy(update={"mode": "peer"}), "arm"))
        scene.during(ask, foe, "arm", "status", session_name(settings, "2"))
        foe.declare_queryable(key("arm", "ask/**"), feign)
        scene.during(ask, foe, "arm", "status", session_name(settings, "2"))
    expression = key("arm", f"ask/description/{session_name(scene.tool, 'tool')}")

    def answers(victim: Any) -> list[bytes]:
        replies = list(victim.get(expression, timeout=2.0))
        return [reply.ok.payload.to_bytes() for reply in replies if reply.ok]

    for _ in range(VICTIMS):  # the robot's own answer may be the first
        victim = scene.keep(open_session(scene.tool, "arm"))
        if any(b"feigned" in scene.during(answers, victim) for _ in range(TRIES)):
            return True
    return False


def feigns_presence(scene: Scene) -> bool:
    names = (HOLDER.replace(".1", ".2"), "ghost.1")
    tokens = [
        foe.liveliness().declare_token(key("arm", f"clients/{name}"))
        for foe in scene.foes.values()
        for name in names
    ]
    for me, foe in scene.foes.items():
        scene.during(ask, foe, "arm", "status", me)
    seen = set(scene.robot.clients())
    del tokens
    return bool(seen & set(names))


def replays_setpoints(scene: Scene) -> bool:
    scene.follow()
    old = forged(scene)
    scene.holder.publish(old)
    before = Setpoint.scalars(old, "tick")[0]
    scene.wait(lambda: scene.now.newest_tick == before)
    scene.put(f"setpoint/{HOLDER}", old)
    scene.step()
    return scene.now.newest_tick > before


def changes_the_controller(scene: Scene) -> bool:
    scene.asks("change", whom="control", body=b"{}")
    return bool(scene.holder._asked)


def steers(scene: Scene) -> bool:
    scene.put("targets/{me}", b"target")
    return scene.holder.target() is not None


ATTACKS: dict[str, Callable[[Scene], bool]] = {
    "take authority": takes_authority,
    "release in the holder's name": releases_in_the_holders_name,
    "stop": stops,
    "recover": recovers,
    "inject setpoints": injects_setpoints,
    "replay setpoints": replays_setpoints,
    "change the controller": changes_the_controller,
    "steer": steers,
    "feign States": feigns_states,
    "feign the description": feigns_descriptions,
    "feign presence": feigns_presence,
}
