"""What a node does with each sample, without ROS."""
