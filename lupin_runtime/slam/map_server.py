"""Node `map_server`: publishes a saved map on `/map`, latched and repeated."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lupin_runtime import graph
from lupin_runtime.ros import LupinNode
from lupin_runtime.slam.map_io import load_map
from lupin_runtime.slam.slam_node import map_message


class MapServer(LupinNode):
    """Reads the map `yaml_filename` once and publishes it. Raises MalformedFile or OSError: without a map the process ends."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("map_server", parameters)
        path = self.parameter("yaml_filename", "")
        frame = self.parameter("frame_id", graph.MAP_FRAME)
        # The console's bridge subscribes without durability; it would never receive a map that is published once.
        period_s = self.parameter("map_update_interval", 5.0)
        if not path:
            self.destroy_node()
            raise ValueError("map_server needs yaml_filename: a map's YAML, as /slam_toolbox/save_map writes it")
        try:
            grid = load_map(Path(path).expanduser())
        except (OSError, ValueError):
            self.destroy_node()
            raise
        self._message = map_message(grid, frame, self.now_ns())
        self._publisher = self.publisher(graph.MAP)
        self._publisher.publish(self._message)
        self.create_timer(period_s, lambda: self._publisher.publish(self._message))
