"""Pictures of a robot in a posture: flat polygons in the order in which they hide each other."""
