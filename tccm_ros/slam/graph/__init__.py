"""The graph of the trajectory in GTSAM: batch, incremental and continued solutions."""
