"""Domain values as ROS messages, live and in bags: pure functions in pairs."""
