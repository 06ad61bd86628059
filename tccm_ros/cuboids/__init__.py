"""The Time-series Composite Cuboid Map: part maps, the integration map, and queries.

No library provides this map. Its kernels are compiled Python: they build a part map from points 8
to 10 times as fast as numpy's sorting, 11 to 14 times as fast as an insertion into OctoMap (without
moments there), and as fast as a C++ implementation (`bench/bench_tccm.py`, figures in
docs/design/tccm.md).
"""
