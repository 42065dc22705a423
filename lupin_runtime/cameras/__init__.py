"""The cameras' drivers on the robot, and the video server: JPEG images over HTTP."""
