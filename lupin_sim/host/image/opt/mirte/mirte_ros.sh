#!/bin/bash
# Does what the vendor's script does: starts the discovery server once, without a check that it came up, and launches the robot.
source /home/mirte/.mirte_settings.sh

if [ "$MIRTE_FASTDDS" = "true" ]; then
  if command -v fast-discovery-server >/dev/null; then
    fast-discovery-server -i 0 -l 0.0.0.0 -p 11811 &
  else
    echo "fast-discovery-server tool not found!"
  fi
fi

source /home/mirte/mirte_ws/install/setup.bash
exec /opt/mirte/launch-robot
