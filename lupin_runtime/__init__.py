"""What runs: every node of the robot's stack, each a pure core beside a thin shell on the ROS graph."""
