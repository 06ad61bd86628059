"""Publishers of a node: messages for subscribers alone, the live pose, tf."""
