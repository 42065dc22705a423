"""The TCP and UDP ports that programs of this system listen on, without rclpy."""

from __future__ import annotations

CONSOLE_PORT = 8090  # the page
ROSBRIDGE_PORT = 9090  # the default of every rosbridge client
VIDEO_PORT = 8091  # the cameras' images; the vendor's web_video_server uses 8181
FOXGLOVE_PORT = 8765  # the default of Foxglove and Lichtblick
DISCOVERY_PORT = 11811  # UDP, the default of Fast DDS's discovery server
