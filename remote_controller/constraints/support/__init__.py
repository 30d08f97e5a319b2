"""Balance on the soles: support polygon and zero-moment point."""
