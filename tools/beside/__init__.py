"""What something that runs beside a robot adds to its misses: `hoap3 bench clients`.

`race` runs pairs with and without it, `clients` is one such thing, `show` prints the table.
"""
