"""Conversion between CDR, the encoding of ROS 2 messages, and records or messages."""
