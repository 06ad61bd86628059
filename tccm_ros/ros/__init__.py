"""Convert records to ROS messages and back, for rosidl and rosbags message classes."""
