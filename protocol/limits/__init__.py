"""What a joint can do: limits of setpoints, torques, accelerations and jerks, with oracles."""
