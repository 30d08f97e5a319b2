"""What controllers that command accelerations and torques claim, recomputed in plain numpy."""
