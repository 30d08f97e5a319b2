"""Attacks on a robot, in plain and with certificates, also from another network."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from support import HOUSE
from support.attacks.attacks import ATTACKS
from support.attacks.doors import doors
from support.attacks.scene import Scene, attacked_laboratory
from support.attacks.two_networks import ROBOT, TwoNetworks
from support.certificates.laboratory import laboratory
from support.command_bench import (
    PATIENT,
    QUIET,
    assert_no_traceback,
    controller,
    emulator,
    free_port,
    hoap3,
    on_path,
)

NO_SESSION = ("nobody's certificate", "another authority's", "expired", "in plain")
LETS_IN = {"an observer": True, **dict.fromkeys(NO_SESSION, False)}


def succeeds(attack: str, how: str) -> bool:
    """Who reaches a robot without certificates does all but repeat what others have sent."""
    return how == "plain" and attack != "replay setpoints"


@pytest.fixture(scope="module")
def certs(tmp_path_factory) -> Path:
    return attacked_laboratory(tmp_path_factory.mktemp("lab") / "certs")


@pytest.fixture(params=["plain", "with certificates"])
def how(request) -> str:
    return request.param


@pytest.fixture
def scene(how, certs) -> Iterator[Scene]:
    one = Scene(f"127.0.0.1:{free_port()}", None if how == "plain" else certs)
    yield one
    one.close()


@pytest.mark.slow
@pytest.mark.parametrize("attack", ATTACKS)
def test_certificates_refuse_what_succeeds_in_plain(attack, how, scene):
    assert ATTACKS[attack](scene) == succeeds(attack, how)


@pytest.mark.slow
@pytest.mark.parametrize("how", ["with certificates"], indirect=True)
def test_who_has_no_valid_certificate_has_no_session(scene, certs, tmp_path):
    assert doors(scene.place, certs, laboratory(tmp_path / "other")) == LETS_IN


PLACE = f"{ROBOT}:7447"


@pytest.fixture(scope="module")
def networks() -> Iterator[TwoNetworks]:
    with TwoNetworks() as both:
        yield both


def from_field(networks: TwoNetworks, *words: object) -> Any:
    """What `support.attacks.from_afar` finds in the network that the robot is not in."""
    done = subprocess.run(
        [*networks.field, sys.executable, "-m", "support.attacks.from_afar", *map(str, words)],
        env={**os.environ, **on_path(HOUSE / "tests")},
        stdout=subprocess.PIPE,
        check=True,
    )
    return json.loads(done.stdout)


@pytest.mark.slow
def test_attacks_end_as_they_do_on_one_machine(networks, tmp_path):
    certs = attacked_laboratory(tmp_path / "certs", "arm", [ROBOT])
    found = from_field(networks, "attacks", PLACE, certs, *networks.robot)
    for how, results in found.items():
        assert results == {attack: succeeds(attack, how) for attack in ATTACKS}


@pytest.mark.slow
def test_a_controller_drives_whom_strangers_do_not_reach(networks, tmp_path):
    certs = attacked_laboratory(tmp_path / "certs", "hoap3", [ROBOT])
    other, at = laboratory(tmp_path / "other"), f"tls/{PLACE}"

    def tell(verb: str, name: str) -> Any:
        words = (verb, "hoap3", "--secure", certs / name, "--connect", at, "--json")
        return hoap3(*words, wrapper=networks.field).json()

    robot, law = ("--secure", certs / "hoap3"), ("--secure", certs / "qp")
    with (
        emulator("hoap3", *QUIET, *PATIENT, *robot, at=at, wrapper=networks.robot) as ours,
        controller("qp12", *QUIET, *law, at=at, wrapper=networks.field) as theirs,
    ):
        theirs.wait_for("following robot")
        before = tell("status", "otto")
        assert before["holder"].startswith("qp.")
        assert from_field(networks, "doors", PLACE, certs, other) == LETS_IN
        after = tell("status", "otto")
        assert (after["mode"], after["holder"]) == ("active", before["holder"])
        assert after["tick"] > before["tick"]
        assert hoap3("status", "hoap3", "--connect", f"tcp/{PLACE}", wrapper=networks.field).end()
        assert tell("stop", "anna")["mode"] in {"stopping", "stopped"}
        for command in (ours, theirs):
            assert_no_traceback(command)


@pytest.mark.slow
def test_without_certificates_it_listens_there_only_where_that_is_wanted(networks):
    at = f"tcp/{PLACE}"
    listens = ("hoap3", *QUIET, "--set", f"link.listen=[{at}]")
    assert hoap3("emulator", *listens, wrapper=networks.robot).end() == 2
    with emulator("hoap3", *QUIET, "--insecure", at=at, wrapper=networks.robot):
        words = ("status", "hoap3", "--connect", at, "--json")
        assert hoap3(*words, wrapper=networks.field).json()["mode"] == "idle"
