"""Packages of your own to begin with."""
