"""Bridges from a running robot to Foxglove, PlotJuggler, and ROS 2 over Zenoh."""
