"""The secure profile: who is who by certificate, and what each role may do."""
