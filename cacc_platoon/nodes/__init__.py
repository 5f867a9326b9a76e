"""The rclpy nodes of a platoon, thin, and the hosts that run them."""
