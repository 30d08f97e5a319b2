"""A robot with a free base on its soles: settings, outlines on the ground, and the problem."""
