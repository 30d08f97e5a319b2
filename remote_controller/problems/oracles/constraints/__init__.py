"""What a config's constraints ask of the velocity of each cycle, recomputed in plain numpy."""
