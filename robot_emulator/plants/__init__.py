"""Plants: what a robot's body does with the setpoint that it is given."""
