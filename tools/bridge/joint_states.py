"""Joint states of a robot that runs, packed as those of a log are."""

from __future__ import annotations

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.messages import State
from hoap3.tools.logs.log_format import JointStates


def joint_states(description: RobotDescription) -> JointStates:
    """What packs `sensor_msgs/msg/JointState` from this robot's States."""
    made = JointStates(description.joint_names)
    lengths = dict.fromkeys(State.schema.arrays, 0) | description.state_lengths
    made.learn(State.schema.dtype(lengths), lengths)
    return made
