"""URDFs as vendors write them."""
