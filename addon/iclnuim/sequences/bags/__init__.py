"""Sequences in ROS bags, and folders that recordings and logs left."""
