"""`hoap3 robot import` and `check`, and a vendor's URDF wherever a robot can be named."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path

import pytest
import yaml
from support.command_bench import inside
from support.urdfs.vendor_arm import JOINTS, LINKS, PACKAGE, joint, link, urdf, vendor_folder

from hoap3 import load_robot
from hoap3.protocol.errors import UrdfWarning
from hoap3.robot_emulator.robots.urdf_import.imported import import_robot

GUESSED_JOINTS = JOINTS.replace('velocity="2" effort="30"', "", 1)
GUESSED = urdf(joints=GUESSED_JOINTS)


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    """The current folder, with a vendor's package in it."""
    monkeypatch.chdir(tmp_path)
    vendor_folder(tmp_path)
    return tmp_path


ARM = f"{PACKAGE}/urdf/arm.urdf"


def test_an_import_writes_a_robot_that_loads_as_the_urdf_did(here):
    done = inside("robot", "import", ARM)
    assert done.code == 0, done.stderr
    assert load_robot("./acme_arm").digest == import_robot(ARM).description.digest
    assert {str(path.relative_to(here / "acme_arm")) for path in here.glob("acme_arm/**/*.*")} == {
        "robot.yaml", "acme_arm.urdf", "meshes/base.stl", "meshes/upper.stl",
    }  # fmt: skip


def test_every_unused_attribute_is_named(here):
    names = [f"vendor_{place}" for place in range(9)]
    unused = " ".join(f'{name}="1"' for name in names)
    vendor_folder(here, urdf().replace("<robot ", f"<robot {unused} ", 1))
    done = inside("robot", "import", ARM)
    assert done.code == 0, done.stderr
    assert all(f"1 {name} of <robot>" in done.stderr for name in names)


def test_robot_yaml_says_what_was_guessed_and_why(here):
    vendor_folder(here, GUESSED)
    assert inside("robot", "import", ARM, "--out", "mine", "--name", "mine").code == 0
    text = (here / "mine" / "robot.yaml").read_text()
    head, _, rest = text.partition("\nname: mine\n")
    assert all(line.startswith("#") for line in head.splitlines())
    assert "velocity 1 rad/s" in head
    assert hashlib.sha256(GUESSED.encode()).hexdigest() in head
    content = yaml.safe_load(rest)
    slow = {"setpoint_acceleration_max": 5.0, "brake_acceleration": 5.0}
    guessed = {"guessed": ["velocity", "acceleration"]}
    assert content["joints"][0] == {"name": "shoulder", **slow, **guessed}
    assert content["joints"][1] == {"name": "elbow", "guessed": ["acceleration"]}
    whys = [line for line in rest.splitlines() if line.strip().startswith("# guessed")]
    assert [line.split()[2] for line in whys] == ["velocity:", "acceleration:"]  # once each


def test_meshes_are_copied_and_known_by_their_digest(here):
    assert inside("robot", "import", ARM).code == 0
    content = yaml.safe_load((here / "acme_arm" / "robot.yaml").read_text())
    for mesh in content["meshes"]:
        copied = (here / "acme_arm" / "meshes" / mesh["file"]).read_bytes()
        assert hashlib.sha256(copied).hexdigest() == mesh["sha256"]
        assert copied == (here / PACKAGE / "meshes" / mesh["file"]).read_bytes()
    assert [mesh["link"] for mesh in content["meshes"]] == ["base", "upper"]
    assert "mesh" not in load_robot("./acme_arm").to_json().decode()


def test_meshes_of_the_same_name_do_not_replace_each_other(here):
    other = here / PACKAGE / "other"
    other.mkdir()
    (other / "base.stl").write_bytes((here / PACKAGE / "meshes" / "upper.stl").read_bytes())
    (other / "same.stl").write_bytes((here / PACKAGE / "meshes" / "base.stl").read_bytes())
    text = urdf(LINKS.replace(link("fore"), link("fore", "../other/base.stl")))
    vendor_folder(here, text)
    assert inside("robot", "import", ARM).code == 0
    names = {path.name for path in (here / "acme_arm" / "meshes").iterdir()}
    assert names == {"base.stl", "base_2.stl", "upper.stl"}


def test_a_folder_that_holds_something_is_not_written_over(here):
    (here / "acme_arm").mkdir()
    (here / "acme_arm" / "mine.txt").write_text("")
    done = inside("robot", "import", ARM)
    assert done.code == 2
    assert "--out" in done.stderr
    assert [path.name for path in (here / "acme_arm").iterdir()] == ["mine.txt"]


def test_a_name_that_would_lead_out_of_the_folder_is_harmless(here):
    strange = here / PACKAGE / "meshes" / "..upper and lower;.stl"
    (here / PACKAGE / "meshes" / "upper.stl").rename(strange)
    vendor_folder(here, urdf().replace("upper.stl", strange.name))
    assert inside("robot", "import", ARM).code == 0
    assert load_robot("./acme_arm").n == 3


def test_packages_elsewhere_are_named_by_an_option(here):
    (here / "copy.urdf").write_text(urdf())
    vendor_folder(here / "share")
    (here / PACKAGE).rename(here / "hidden")
    done = inside("robot", "import", "copy.urdf", "--out", "first")
    assert "--package-path" in done.stderr
    assert not (here / "first" / "meshes").exists()
    done = inside("robot", "import", "copy.urdf", "--strict")
    assert done.code == 2
    assert "'base'" in done.stderr
    options = ("--package-path", "share", "--strict")
    assert inside("robot", "import", "copy.urdf", *options).code == 0
    assert len(list((here / "acme_arm" / "meshes").iterdir())) == 2
    found = inside("robot", "check", "copy.urdf", *options, "--json").json()
    assert found["shapes"]["upper"] == {"cylinder": 1, "sphere": 2}


def test_a_folder_that_has_its_meshes_takes_no_packages(here):
    assert inside("robot", "import", ARM).code == 0
    done = inside("robot", "check", "./acme_arm", "--package-path", "share")
    assert done.code == 2
    assert "--package-path" in done.stderr
    assert inside("robot", "check", "./acme_arm").code == 0


@pytest.mark.parametrize("as_folder", [False, True])
def test_a_check_says_what_the_robot_is(here, as_folder):
    mimic_joint = joint("grip", "hand", "finger", '<mimic joint="wrist" multiplier="0.5"/>')
    wheel = joint("wheel", "base", "rim", "", "continuous")
    links = LINKS + link("finger") + link("rim")
    vendor_folder(here, urdf(links, GUESSED_JOINTS + mimic_joint + wheel))
    path = ARM
    if as_folder:
        assert inside("robot", "import", ARM).code == 0
        path = "acme_arm"
    found = inside("robot", "check", path, "--json").json()
    assert [each["name"] for each in found["joints"]] == ["shoulder", "elbow", "wrist", "wheel"]
    assert found["joints"][0]["guessed"] == ["velocity", "acceleration"]
    assert found["joints"][0]["effort"] is None
    assert found["joints"][3]["kind"] == "continuous"
    assert (found["joints"][3]["lower"], found["joints"][3]["upper"]) == (None, None)
    assert [(each["name"], each["follows"]) for each in found["followers"]] == [("grip", "wrist")]
    assert found["command_kinds"] == ["position", "acceleration"]
    assert found["mass_kg"]["all"] == pytest.approx(12.0)
    assert found["mass_kg"]["moving"] == pytest.approx(10.0)
    assert found["default_task"]["point"] == "hand"
    shown = inside("robot", "check", path)
    assert shown.code == 0
    assert re.search("grip.*wrist", shown.stdout)


def test_a_check_finds_meshes_that_are_missing_or_others(here):
    """The two links drawn with `base.stl` are one finding."""
    vendor_folder(here, urdf(LINKS.replace(link("fore"), link("fore", "base.stl"))))
    assert inside("robot", "import", ARM).code == 0
    kept = here / "acme_arm" / "meshes"
    good = inside("robot", "check", "acme_arm", "--strict", "--json")
    assert (good.code, good.json()["meshes"], good.json()["notes"]) == (0, 3, [])
    content = (kept / "base.stl").read_bytes()
    (kept / "base.stl").write_bytes(content + b"\n")
    (kept / "upper.stl").unlink()
    found = inside("robot", "check", "acme_arm", "--json")
    assert found.code == 0
    changed, gone = found.json()["notes"]
    assert "meshes/base.stl" in changed
    assert hashlib.sha256(content + b"\n").hexdigest() in changed
    assert "'upper.stl'" in gone
    shown = inside("robot", "check", "acme_arm")
    assert {changed, gone} <= set(shown.stdout.splitlines())  # a line each
    strict = inside("robot", "check", "acme_arm", "--strict")
    assert strict.code == 2
    assert not strict.stdout
    assert "meshes/base.stl" in strict.stderr
    assert "'upper.stl'" in strict.stderr


def test_a_shipped_robot_is_checked_by_its_name():
    found = inside("robot", "check", "ur5", "--json").json()
    assert len(found["joints"]) == 6
    assert not any(each["guessed"] for each in found["joints"])


def test_names_of_any_script_come_back_from_the_folder(here):
    """Emoji lie beyond 16 bits; U+0085 and U+2028 break lines of YAML."""
    name = "hand \U0001f916 \u0631\u0648\u0628\u0648\u062a \x85\u2028\ufeff end"
    vendor_folder(here, urdf().replace('"hand"', f'"{name}"').replace('"base"', f'"base {name}"'))
    assert inside("robot", "import", ARM).code == 0
    assert load_robot("./acme_arm").default_task.point == name
    assert load_robot("./acme_arm").digest == import_robot(ARM).description.digest


def test_what_an_import_advises_means_the_new_robot(here):
    """A shipped robot has the same name."""
    done = inside("robot", "import", ARM, "--name", "ur5")
    advised = [line.partition("hoap3 ")[2].split() for line in done.stderr.splitlines()]
    (check,) = [words for words in advised if words[:2] == ["robot", "check"]]
    assert len(inside(*check, "--json").json()["joints"]) == 3  # UR5 has 6


@pytest.mark.parametrize("command", ["import", "check"])
@pytest.mark.parametrize("as_json", [(), ("--json",)])
def test_what_is_wrong_ends_in_one_line_and_exit_code_2(here, command, as_json):
    vendor_folder(here, urdf(joints=JOINTS.replace('lower="-2"', 'lower="9"', 1)))
    done = inside("robot", command, ARM, *as_json)
    assert done.code == 2
    assert "'shoulder'" in done.stderr
    assert done.stderr.strip().count("\n") == 0
    assert not done.stdout


@pytest.mark.filterwarnings("default::hoap3.protocol.errors.UrdfWarning")
def test_run_takes_a_urdf_and_says_once_what_was_guessed(here):
    vendor_folder(here, GUESSED)
    done = inside("run", "--lockstep", "--robot", ARM, "--duration", 0.2, "--out", "log", "--json")
    assert done.json()["ticks"] == 200
    guesses = [line for line in done.stderr.splitlines() if "velocity 1 rad/s" in line]
    assert len(guesses) == 1
    assert guesses[0].startswith("note: ")


def test_an_emulator_config_beside_it_names_a_urdf(here):
    (here / "slow.yaml").write_text(f"robot: {ARM}\nplant: {{servo: lag}}\n")
    done = inside("config", "check", "slow.yaml", ARM)
    assert done.code == 0, done.stderr
    assert done.stdout.count("correct config of an emulator") == 2


def test_a_program_hears_of_guesses_by_warnings(here):
    with pytest.warns(UrdfWarning) as said:
        load_robot(ARM)
    assert any("default task" in str(each.message) for each in said)


def test_json_of_an_import_names_what_was_written(here):
    found = inside("robot", "import", ARM, "--json").json()
    assert found["name"] == found["folder"] == "acme_arm"
    assert found["files"] == [
        "robot.yaml", "acme_arm.urdf", "meshes/base.stl", "meshes/upper.stl",
    ]  # fmt: skip
    assert json.dumps(found["notes"])
