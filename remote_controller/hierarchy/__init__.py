"""Tasks that ask for accelerations, and what a hierarchy of them needs."""
