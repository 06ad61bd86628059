"""The graph of the trajectory in GTSAM: solved as a batch, while driving, and going on."""
