"""`hoap3 reproduce`: papers re-made, figure by figure, with what differs and why.

`papers` holds one module a paper; `rows` is what is checked, `figures` what is drawn, `remake` puts
both into a folder, `show` prints it for people.
"""
