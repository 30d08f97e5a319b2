"""What tests of several rooms share: robots, services, logs, and doubles of a machine."""

from pathlib import Path

HOUSE = Path(__file__).resolve().parents[2]
"""Top of the repository."""
