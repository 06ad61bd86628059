"""The Time-series Composite Cuboid Map: part maps, the integration map, and questions to it.

No library has this map. Its kernels stay compiled Python: points become a part map 8 to 10 times as
fast as with numpy's sorting, 11 to 14 times as fast as they enter OctoMap (without moments there),
and as fast as a C++ twin (`bench/bench_tccm.py`, figures in docs/design/tccm.md).
"""
