"""What a page draws: a State and its Setpoint as shapes, points and values."""
