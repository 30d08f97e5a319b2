"""Hashes of ROS 2 types are those that ROS 2 publishes."""

from __future__ import annotations

import pytest

from hoap3.tools.bridge.type_hashes import dds_name, type_hash
from hoap3.tools.logs.log_format import JOINT_STATE, STRING

TIME = "int32 sec\nuint32 nanosec\n"
RULE = "=" * 80 + "\nMSG: "
HEADER = f"builtin_interfaces/Time stamp\nstring frame_id\n{RULE}builtin_interfaces/Time\n{TIME}"
PUBLISHED = {
    "sensor_msgs/msg/JointState": (
        JOINT_STATE,
        "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    ),
    "std_msgs/msg/String": (
        STRING,
        "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    ),
    "builtin_interfaces/msg/Time": (
        TIME,
        "b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197",
    ),
    "std_msgs/msg/Header": (
        HEADER,
        "f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01",
    ),
    "std_msgs/msg/Bool": (
        "bool data",
        "feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9",
    ),
}
"""As `ros2 topic info --verbose` prints them."""


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_type_has_the_hash_that_ros_publishes(name: str) -> None:
    text, expected = PUBLISHED[name]
    assert type_hash(name, text) == f"RIHS01_{expected}"


def test_comments_constants_and_blank_lines_are_no_part_of_it() -> None:
    text = "# what\nint32 MOST=3\n\nstring data  # more\n"
    assert type_hash("std_msgs/msg/String", text) == type_hash("std_msgs/msg/String", STRING)


@pytest.mark.parametrize(
    "text", ["int32[3] data", "string<=5 data", "a_msgs/Other data", "float64"]
)
def test_what_is_not_understood_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="a_msgs"):
        type_hash("a_msgs/msg/Some", text)


def test_the_name_of_dds() -> None:
    assert dds_name("std_msgs/msg/String") == "std_msgs::msg::dds_::String_"
