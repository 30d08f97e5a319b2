"""Controllers beside each other: on a robot each, or on the states of one log."""
