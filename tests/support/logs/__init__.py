"""Logs as other programs write them."""
