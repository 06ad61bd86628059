"""The map for language agents: a few typed questions over the Model Context Protocol."""
