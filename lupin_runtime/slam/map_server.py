"""Node `map_server`: publishes a saved map on `/map`, latched and repeated, and replaces it by another on request."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse

from lupin_runtime import graph
from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.lifecycle import serve_state
from lupin_runtime.slam.map_io import load_map
from lupin_runtime.slam.slam_node import map_message


def map_path(url: str) -> Path:
    """Return the file of a map's URL: a path, or `file://` and an absolute path. Raises ValueError for other URLs."""
    scheme = urlparse(url).scheme
    if scheme == "file":
        return Path(unquote(urlparse(url).path))
    if scheme or not url:
        raise ValueError(f"expected a path or file:///PATH, found {url!r}")
    return Path(url)


class MapServer(LupinNode):
    """Reads the map `yaml_filename` and publishes it. Raises MalformedFile or OSError: without a map the process ends.

    `/map_server/load_map` replaces the map. If the new one cannot be read, the present one is kept.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("map_server", parameters)
        path = self.parameter("yaml_filename", "")
        self._frame = self.parameter("frame_id", graph.MAP_FRAME)
        # The console's bridge subscribes without durability; it would never receive a map that is published once.
        period_s = self.parameter("map_update_interval", 5.0)
        if not path:
            self.destroy_node()
            raise ValueError("map_server needs yaml_filename: a map's YAML, as /slam_toolbox/save_map writes it")
        try:
            grid = load_map(Path(path), self._warn)
        except (OSError, ValueError):
            self.destroy_node()
            raise
        self._message = map_message(grid, self._frame, self.now_ns())
        self._publisher = self.publisher(graph.MAP)
        self._publisher.publish(self._message)
        self.create_timer(period_s, lambda: self._publisher.publish(self._message))
        self.service(graph.MAP_SERVER_MAP, self._get_map)
        self.service(graph.MAP_SERVER_LOAD_MAP, self._load_map)
        serve_state(self, graph.MAP_SERVER_STATE, lambda: True)

    def _get_map(self, _request: Any, response: Any) -> Any:
        response.map = self._message
        return response

    def _load_map(self, request: Any, response: Any) -> Any:
        try:
            grid = load_map(map_path(request.map_url), self._warn)
        except MalformedFile as error:
            return self._refuse(request, response, response.RESULT_INVALID_MAP_DATA, error)
        except (OSError, ValueError) as error:
            return self._refuse(request, response, response.RESULT_MAP_DOES_NOT_EXIST, error)
        self._message = response.map = map_message(grid, self._frame, self.now_ns())
        self._publisher.publish(self._message)
        self.get_logger().info(f"map {request.map_url} loaded: {grid.width} x {grid.height} cells")
        response.result = response.RESULT_SUCCESS
        return response

    def _warn(self, text: str) -> None:
        self.get_logger().warning(text)

    def _refuse(self, request: Any, response: Any, result: int, error: Exception) -> Any:
        self.get_logger().error(f"map {request.map_url!r} was not loaded, the present one is kept: {error}")
        response.result = result
        return response
