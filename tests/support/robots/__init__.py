"""Robots of random shape, and such with mimic joints and with joints that turn without end."""
