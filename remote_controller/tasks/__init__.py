"""Tasks: what a controller is to bring about, as an error that shall vanish."""
