"""Tasks that ask for accelerations, their references and their bounds."""
