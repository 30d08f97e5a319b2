"""A robot that is stepped from outside, as learning code wants it."""
