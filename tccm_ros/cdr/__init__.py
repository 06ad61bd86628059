"""CDR, the encoding of ROS 2 messages: bytes to records, and messages to bytes."""
