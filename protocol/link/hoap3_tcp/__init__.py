"""HOAP-3's own TCP protocol: frames of encoder counts, and the links of both sides over it."""
