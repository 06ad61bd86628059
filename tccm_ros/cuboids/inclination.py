"""Limits of the inclination of planes, for each step that treats vertical planes differently.

Each is a vertical component of the unit normal, |n_z|: 1 for horizontal planes, 0 for vertical
ones. The limits differ because an error has other effects in each step. Which planes are
*horizontal* is a setting, `planes.horizontal_angle`.
"""

FITTED_AS_VERTICAL = 0.20
"""Below this (78 deg and steeper) the cells of a plane form a line, and their walls cut its noise:
it is fitted by `planes.vertical_planes`. Anything less steep has cells that lie side by side, and
is better fitted by these. Chosen: at 78 deg a cell of 20 mm holds 100 mm of height."""

OUTLINED_BY_COLUMNS = 0.35
"""Below this (70 deg and steeper) a plane is outlined from its front, in columns. Chosen: from
above, what one cell covers would be stretched threefold on the plane, 1 / 0.35."""

SEEN_AS_WALL = OUTLINED_BY_COLUMNS
"""Below this a plane carries nothing: no horizontal strip lies on it, and points near it may be of
a wall behind a board. These are the planes that are outlined from their front."""

CROSSES_CELLS_ONCE = 0.8
"""Above this (37 deg and flatter) a plane rises by less than a cell over a cell, as tan 37 deg is
0.75, and so passes each cell once: several of its cuboids in one cell are of something else."""

FIT_OF_A_LINE = 0.8
"""Below this the plane of a horizontal surface's points is not its own: the points lie on a line,
and the fit turned about it. Surfaces are horizontal within `planes.horizontal_angle`, far flatter;
chosen."""
