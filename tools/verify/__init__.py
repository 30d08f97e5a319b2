"""Checks what a log claims, from what the log itself holds, with none of the code that made it."""
