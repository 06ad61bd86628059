"""Records and messages straight from and to CDR bytes, the encoding of ROS 2 messages."""
