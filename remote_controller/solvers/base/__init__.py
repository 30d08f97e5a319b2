"""What all solvers share: statuses, and the validation of arguments."""
