"""Emulator and controller as services: start, observe, count, record, stop."""
