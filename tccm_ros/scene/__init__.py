"""The scene for clients: queries, changes, collision shapes and base poses."""
