"""Where frames may be, and how they may move."""
