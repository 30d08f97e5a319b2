"""systemd units for the two services: their text, and where it is written."""
