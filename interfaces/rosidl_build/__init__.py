"""Builds ROS 2 interface packages with pip: the official generators and libraries from the ROS wheels, gcc, no CMake."""
