"""Where frames come from: a running robot, or logs."""
