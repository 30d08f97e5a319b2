"""`hoap3 reproduce`: papers re-made, figure by figure, with what differs and why.

`papers` holds a package for each paper: its runs, an oracle, rows and figures. `rows` has the data
and the verdict of a row, `figures` draws and writes CSV, `remake` runs a paper and writes its
folder, `show` prints the table.
"""
