"""Tasks as accelerations: what J q̈ shall be, so that errors vanish."""
