"""What both services run on: clock, real time, shared-memory ring, compiled kernels."""
