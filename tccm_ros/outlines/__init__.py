"""Outlines of planes: from cuboids over a raster to rings, what is done with rings, and models.

`boundary` is what others call; `raster`, `gaps`, `edge_cells` and `contour` are its steps, on the
`rings` of which `overlap` tells how much two have in common. `shape_models` chooses the rectangle,
L, circle or polygon that an outline is, and `edge_position` puts its edges where samples expect
them.

The steps stay ours: `shapely.concave_hull` over the same cells takes 30 to 80 times as long, and a
union of the cells, closed and simplified, over 600 times (the last table of
`bench/bench_planes.py`).
"""
