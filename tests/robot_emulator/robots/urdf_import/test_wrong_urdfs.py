"""Wrong input: one line that names the file, and the link or the joint, and says what to do."""

from __future__ import annotations

import os

import pytest
from support.urdfs.vendor_arm import JOINTS, LINKS, joint, link, urdf, vendor_folder

from hoap3.protocol.errors import ConfigError, DescriptionError, UsageError
from hoap3.robot_emulator.robots import load
from hoap3.robot_emulator.robots.urdf_import.imported import import_robot

BOMB = '<!DOCTYPE r [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]>'

WRONG = {
    "empty": ("", "empty"),
    "blank": (" \n", "empty"),
    "broken": (urdf()[:-5], "not well-formed"),
    "entities": (urdf().replace("<robot", f"{BOMB}<robot", 1), "DOCTYPE"),
    "deep": ("<robot name='r'>" + "<a>" * 500 + "</a>" * 500 + "</robot>", "nested"),
    "latin": (urdf(name="caf\xe9").encode("latin-1"), "UTF-8"),
    "wrong encoding": (
        urdf().replace('"1.0"?', '"1.0" encoding="utf-99"?').encode(),
        "Save it as UTF-8",
    ),
    "sdf": ("<sdf/>", "SDF"),
    "mjcf": ("<mujoco/>", "MJCF"),
    "a part": ("<robot name='r'/>", "no <link>"),
    "still": (urdf(link("base"), ""), "no joint moves"),
    "loop": (urdf(LINKS, JOINTS + joint("back", "hand", "base")), "0 links without a parent"),
    "same joint": (urdf(joints=JOINTS.replace('"elbow"', '"wrist"')), "'wrist'.*twice"),
    "nameless joint": (urdf(joints=JOINTS.replace(' name="elbow"', "")), "<joint> without a name"),
    "no such link": (urdf(joints=JOINTS.replace('link="hand"', 'link="hnd"')), "'wrist'.*'hand'"),
    "kind": (urdf(joints=JOINTS.replace('"revolute"', '"revolut"', 1)), "'shoulder'.*'revolute'"),
    "reversed": (
        urdf(joints=JOINTS.replace('lower="-2"', 'lower="3"', 1)),
        "'shoulder'.*reversed.*no limit to Bullet.*continuous",
    ),
    "far range": (
        urdf(joints=JOINTS.replace('"-2" upper="2.5"', '"2e4" upper="3e4"', 1)),
        "'shoulder'.*rad",
    ),
    "worded limit": (urdf(joints=JOINTS.replace('"-2"', '"low"', 1)), "'shoulder'.*'low'"),
    "nan limit": (urdf(joints=JOINTS.replace('"-2"', '"nan"', 1)), "'shoulder'.*'nan'"),
    "nan origin": (urdf(joints=JOINTS.replace("0 0 0.3", "0 0 nan", 1)), "'shoulder'.*finite"),
    "short axis": (urdf(joints=JOINTS.replace("1 0 0", "1 0", 1)), "'wrist'.*3 finite"),
    "long name": (urdf(joints=JOINTS.replace('"elbow"', f'"{"e" * 65}"')), "'eee.*65"),
    "same when renamed": (
        urdf(joints=JOINTS.replace('"elbow"', '"a b"').replace('"wrist"', '"a(b"')),
        "'a_b'",
    ),
    "many": (
        urdf(
            "".join(link(f"l{k}") for k in range(131)),
            "".join(joint(f"j{k}", f"l{k}", f"l{k + 1}") for k in range(130)),
        ),
        "130 joints",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_wrong_input_is_told_in_one_line(tmp_path, case):
    text, said = WRONG[case]
    path = vendor_folder(tmp_path, text if isinstance(text, bytes) else text.encode())
    with pytest.raises(DescriptionError, match=said) as caught:
        import_robot(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message


def test_another_encoding_that_the_file_states_is_read(tmp_path):
    text = urdf(name="caf\xe9").replace('"1.0"?', '"1.0" encoding="latin-1"?')
    assert import_robot(vendor_folder(tmp_path, text.encode("latin-1"))).file.name == "caf"
    marked = b"\xef\xbb\xbf" + urdf().encode()
    assert import_robot(vendor_folder(tmp_path, marked)).file.name == "acme_arm"


@pytest.mark.parametrize("make", ["nothing", "folder", "fifo", "device"])
def test_what_cannot_be_read_as_a_file_is_named(tmp_path, make):
    path = tmp_path / "arm.urdf"
    if make == "folder":
        path.mkdir()
    elif make == "fifo":
        os.mkfifo(path)
    elif make == "device":
        path.symlink_to("/dev/zero")
    with pytest.raises(ConfigError, match=r"arm\.urdf"):
        load(path)


def test_a_huge_file_is_not_read(tmp_path):
    path = tmp_path / "arm.urdf"
    with open(path, "wb") as stream:
        stream.truncate(1 << 32)
    with pytest.raises(DescriptionError, match="MiB"):
        load(path)


@pytest.mark.parametrize("name", ["", "Arm", "1arm", "a" * 33, "a b", "a/b"])
def test_a_name_that_is_none_is_refused(tmp_path, name):
    with pytest.raises(UsageError, match="--name"):
        import_robot(vendor_folder(tmp_path), called=name)


def test_an_unknown_robot_is_told_that_a_urdf_would_do():
    with pytest.raises(UsageError, match="URDF"):
        load("no_such_robot")
