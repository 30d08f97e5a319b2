"""What MuJoCo reads, and whether it fits the robot and the settings."""
