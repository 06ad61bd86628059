"""The process that solves the map of a SLAM node, and the channel between them."""
