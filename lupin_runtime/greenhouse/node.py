"""Node `greenhouse_bridge`: one service over the greenhouse simulator."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lupin_msgs.msg import SensorReading, TagReading
from lupin_msgs.srv import GetTagReading

from lupin_runtime import graph
from lupin_runtime.greenhouse.climate_simulator import ClimateSimulator, Overrides, UnknownTag
from lupin_runtime.ros import LupinNode, stamp_from_ns


class GreenhouseBridge(LupinNode):
    """Serves the climate at a tag. It refuses to start with an unusable file; the message names file and line.

    A reading's stamp is ROS time; its time of day is the greenhouse's, which runs `speedup_factor` times as fast.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("greenhouse_bridge", parameters)
        tag_file, config_file = str(self.parameter("tag_file", "")), str(self.parameter("sim_config_file", ""))
        self._climate = ClimateSimulator(
            Path(tag_file).expanduser() if tag_file else None,
            Path(config_file).expanduser() if config_file else None,
            Overrides(
                debug_time_of_day=float(self.parameter("debug_time_of_day", -1.0)),
                speedup_factor=float(self.parameter("speedup_factor", 0.0)),
                debug_seed=int(self.parameter("debug_seed", -1)),
            ),
            clock_s=lambda: self.now_ns() / 1e9,
        )
        self.service(graph.GET_TAG_READING, self._read)
        self.get_logger().info(f"greenhouse with {len(self._climate.tags)} tags")

    def _read(self, request: GetTagReading.Request, response: GetTagReading.Response) -> GetTagReading.Response:
        try:
            reading = self._climate.read(request.tag_id)
        except UnknownTag as error:
            response.status = GetTagReading.Response.STATUS_UNKNOWN_TAG
            response.error_message = str(error)
            return response
        response.status = GetTagReading.Response.STATUS_OK
        response.reading = TagReading(
            tag_id=request.tag_id,
            stamp=stamp_from_ns(self.now_ns()),
            sim_time_of_day_seconds=reading.time_of_day_s,
            readings=[SensorReading(name=name, value=value) for name, value in reading.values.items()],
        )
        return response
