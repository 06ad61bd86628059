"""Process recorded bags with the processors of the live nodes, and write the results."""
