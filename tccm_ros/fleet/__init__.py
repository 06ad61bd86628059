"""Many recordings and maps: replay on Dask distributed, a catalogue, and merging of maps."""
