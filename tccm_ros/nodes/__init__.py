"""The rclpy nodes: thin shells around the processors."""
