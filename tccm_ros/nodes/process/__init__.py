"""Life of a node's process: worker threads, child processes, compilation, its end."""
