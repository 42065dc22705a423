"""The cameras' drivers on the robot, and the video server: JPEG pictures over HTTP."""
