"""The process that reads door signs, and the node's side of it."""
