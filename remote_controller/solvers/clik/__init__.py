"""Closed-loop inverse kinematics of prioritised tasks with constant gains."""
