"""Robots of random shape, and such with followers and with joints that turn without end."""
