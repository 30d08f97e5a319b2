"""A running robot in other people's viewers: Foxglove, PlotJuggler, and ROS 2 over Zenoh."""
