"""Reading settings: YAML that may be hostile, strict types, errors that name the key."""
