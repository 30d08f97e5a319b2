"""References: where a task's target is at each time."""
