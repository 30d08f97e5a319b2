"""The QP of task-space inverse dynamics."""
