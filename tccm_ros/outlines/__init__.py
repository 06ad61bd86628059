"""Outlines of planes: from cuboids to a raster to rings, operations on rings, and shape models.

`boundary` is the interface; `raster`, `gaps`, `edge_cells` and `contour` are its steps, and `rings`
has the operations on rings. `overlap` computes the common area of two rings. `shape_models` selects
the rectangle, L, circle or polygon that fits an outline, and `edge_position` estimates the position
of its edges from samples.

No library replaces these steps: `shapely.concave_hull` over the same cells takes 30 to 80 times as
long, and a union of the cells, closed and simplified, over 600 times (the last table of
`bench/bench_planes.py`).
"""
