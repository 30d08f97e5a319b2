"""Tasks and constraints once more, in plain numpy and Pinocchio: no kernel, no solver."""
