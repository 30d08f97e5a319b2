"""What stands between setpoints and motors: its law in real numbers, in few bits, and compiled."""
