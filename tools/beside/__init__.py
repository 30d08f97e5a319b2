"""What something that runs beside a robot adds to its misses: `hoap3 bench clients` and `view`.

`race` runs pairs with and without it, `clients` and `page` are such things, `show` prints the
table.
"""
