"""Problems solved as papers print them, to compare solvers with."""
