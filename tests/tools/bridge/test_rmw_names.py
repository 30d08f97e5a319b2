"""Keys, tokens and attachments are those of the design document of rmw_zenoh; GIDs are XXH3-128."""

from __future__ import annotations

import struct

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from hoap3.tools.bridge.rmw_zenoh import TYPES, Node, Publisher
from hoap3.tools.logs.log_format import JOINT_STATE, STRING

CHATTER = (
    "std_msgs::msg::dds_::String_/"
    "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
)
TALKER = Node(2, "8b20917502ee955ac4476e0266340d5c", "", "talker")
ROBOT1 = Node(0, "8b20917502ee955ac4476e0266340d5c", "/robot1", "talker")
HASHED = {
    129: "1b2a04bb6f5aea4629c7ebbe717a3e99",
    160: "ef2c14d467ea3ad30c86b2a791f149b5",
    161: "f4c1c8755e0cee3d3eb2948d58bc5213",
    240: "69371d8abe9e0bb3d73595ee6e6142f7",
    241: "400794369a5faa908344b437a8884d70",
    1024: "8e1f65a6997c6520eca7ae352a756798",
    1025: "f31af152b1d7b3bcf5eed2b9f05cb971",
    1100: "a83e7bbbddace7f2087b5236d89ff82d",
}
"""XXH3-128 by xxHash 0.8.4, little endian, of the first so many bytes of `TEXT`."""
TEXT = b"@ros2_lv/0/" * 200


def test_a_topic_of_the_design_document() -> None:
    chatter = TALKER.publisher(10, "chatter", "std_msgs/msg/String", depth=7)
    assert chatter.key == f"2/chatter/{CHATTER}"
    assert chatter.token == (
        "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/"
        f"{CHATTER}/::,7:,:,:,,"
    )
    assert TALKER.token == "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/0/NN/%/%/talker"


def test_a_namespace_stands_before_the_topic_and_in_the_tokens() -> None:
    chatter = ROBOT1.publisher(1, "chatter", "std_msgs/msg/String", depth=1, latched=True)
    assert chatter.key == f"0/robot1/chatter/{CHATTER}"
    assert ROBOT1.token.endswith("/0/0/NN/%/%robot1/talker")
    end = f"/0/1/MP/%/%robot1/talker/%robot1%chatter/{CHATTER}/:1:,1:,:,:,,"
    assert chatter.token.endswith(end)


def test_an_attachment_is_number_stamp_and_gid() -> None:
    chatter = TALKER.publisher(10, "chatter", "std_msgs/msg/String", depth=7)
    attachment = chatter.attachment(3, 1_700_000_000_123_456_789)
    assert struct.unpack("<qqB16s", attachment) == (3, 1_700_000_000_123_456_789, 16, chatter.gid)


@pytest.mark.parametrize("size", HASHED)
def test_a_gid_is_the_hash_of_xxhash(size: int) -> None:
    assert Publisher("", TEXT[:size].decode()).gid.hex() == HASHED[size]


@pytest.mark.parametrize(
    ("name", "schema"),
    [("sensor_msgs/msg/JointState", JOINT_STATE), ("std_msgs/msg/String", STRING)],
)
def test_a_type_has_the_hash_of_its_schema(name: str, schema: str) -> None:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema, name))
    package, _, leaf = name.split("/")
    assert TYPES[name] == f"{package}::msg::dds_::{leaf}_/{store.hash_rihs01(name)}"
