"""What a controller solves in each cycle, stated as data, and a check of the logged answer.

A `ProblemBuilder` reads the events of a log and states the problem of each answer: numbers from
plain numpy and Pinocchio, without the controller and its kernels. `check` says whether the answer
solves that problem; it knows no controller.
"""
