"""Conversion between records and ROS messages, for rosidl and rosbags message classes."""
