"""What a joint can do that has a limit of jerk besides."""
