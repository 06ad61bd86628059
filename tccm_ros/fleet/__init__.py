"""Many recordings and many maps: runs on Dask distributed, a catalogue, one map of many."""
