"""Links between a robot and its controller: in one process, over Zenoh, in lockstep."""
