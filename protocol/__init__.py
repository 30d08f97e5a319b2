"""What a robot and its controller agree on: messages, links, clocks, description, words.

Importing this package loads neither Pinocchio nor numba nor Zenoh.
"""

from __future__ import annotations

__version__ = "0.2.0"
