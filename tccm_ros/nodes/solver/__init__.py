"""The solver process of a SLAM node, and the channel between them."""
