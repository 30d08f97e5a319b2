"""`hoap3 doctor`: is this machine fit for a 1 kHz loop, and what would help."""
