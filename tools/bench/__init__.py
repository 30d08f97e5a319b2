"""`hoap3 bench`: what solvers and cycles cost, beside each other in the same run."""
