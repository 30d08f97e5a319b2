"""What a cycle of controllers of accelerations is made of: tasks, bounds, dynamics, priorities."""
