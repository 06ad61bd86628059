"""What the arrays of the binning hold, element by element.

Cells are counted in tiles of 64 x 64, made where points fall, so that the memory follows what was
seen and not the box around it. A cell's address is ``slot * 4096 + x * 64 + y``; a bitmap of the
counted cells lets them be listed in order without sorting.
"""

import numpy as np

TILE = 64
"""Cells along a tile's edge: one row is one word of the bitmap."""

CELLS_PER_TILE = TILE * TILE

BLOCK = 512
"""Beams that are worked on together: their scratch rows stay in the first cache."""

# Rows of the scratch array, int32: whether the beam is used, its tile in the directory, its cell
# in the tile, its height in ticks, its place in the cell (x << 16 | y) and its depth in ticks.
USED, TILE_OF, CELL_OF, HEIGHT, PLACE, DEPTH_OF = (np.uint64(row * BLOCK) for row in range(6))

WORK_SIZE = 6 * BLOCK
"""Elements of the scratch array `work`, int32."""

GROW_TILES, GROW_SLOTS = -1, -2
"""What `bin_scan` asks for before it goes on."""

# Elements of `meta`, int64: what the kernels count, where the directory of tiles lies, the box of
# tiles that it must cover, and the span of heights.
N_POINTS, N_SLOTS, TILE_X0, TILE_Y0, TILES_X, TILES_Y, NEXT_BEAM = range(7)
BOX_X0, BOX_X1, BOX_Y0, BOX_Y1 = range(7, 11)
LOWEST, HIGHEST = 11, 12
N_META = 13

# Elements of `limits`, float64: settings, the region, and the normal of the scan before's plane.
TICKS, CELL_TICKS, DEPTH, DEPTH_PER_RANGE, MAX_DEPTH, REGION_IN = range(6)
REGION = 6
NORMAL, HAS_NORMAL = 12, 15
N_LIMITS = 16

NO_REGION, REGION_IN_ODOM, REGION_IN_BASE = 0, 1, 2
