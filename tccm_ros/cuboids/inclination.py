"""Inclination limits of planes, for the steps that treat vertical planes differently.

A limit is a vertical component of the unit normal, |n_z|: 1 for horizontal planes, 0 for vertical
ones. The limits differ because an error has a different effect in each step. The definition of
*horizontal* planes is a parameter, `planes.horizontal_angle`.
"""

FITTED_AS_VERTICAL = 0.20
"""|n_z| below which (78 deg and steeper) the cells of a plane form a line, and the cell borders
truncate its noise: `planes.vertical_planes` fits it. Flatter planes have adjacent cells, and are
fitted from these. Chosen: at 78 deg, a cell of 20 mm covers 100 mm of height."""

OUTLINED_BY_COLUMNS = 0.35
"""|n_z| below which (70 deg and steeper) a plane is outlined from its front, in columns. Chosen:
from above, a cell would be stretched threefold on the plane, 1 / 0.35."""

SEEN_AS_WALL = OUTLINED_BY_COLUMNS
"""|n_z| below which a plane supports nothing: no horizontal strip is on it. These planes are
outlined from their front."""

CROSSES_CELLS_ONCE = 0.8
"""|n_z| above which (37 deg and flatter) a plane rises by less than a cell per cell, as tan 37 deg
is 0.75, and has at most one cuboid per cell: further cuboids in a cell belong to other objects."""

FIT_OF_A_LINE = 0.8
"""|n_z| below which the plane fit of a horizontal surface is degenerate: the points are on a line,
and the fit rotates about it. Surfaces are horizontal within `planes.horizontal_angle`, which is
much smaller; chosen."""
