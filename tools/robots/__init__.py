"""What is computed of robots and trajectories: facts, and the bounds of their accelerations."""
