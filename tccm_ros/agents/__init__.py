"""The map for language agents: a few typed tools over the Model Context Protocol."""
