"""Tasks of frames: their origins, their orientations, and both."""
