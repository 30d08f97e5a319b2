"""What is computed of robots: the table of pairs, and the bounds of their accelerations."""
