"""A test in the place of systemd."""
