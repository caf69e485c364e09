"""A virtual event camera as a lifecycle node of ROS 2."""
