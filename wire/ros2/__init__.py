"""ROS 2 without ROS: its messages, and a node in its graph over Zenoh."""
