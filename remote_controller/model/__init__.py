"""Kinematics and dynamics of the robot, once per sample."""
