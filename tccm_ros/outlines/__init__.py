"""Outlines of planes: from cuboids over a raster to rings, and what is done with rings.

`boundary` is what others call; `raster`, `gaps`, `edge_cells` and `contour` are its steps, on the
`rings` of which `overlap` tells how much two have in common.
"""
