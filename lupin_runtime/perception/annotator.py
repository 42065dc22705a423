"""Node `tag_annotator`: publishes the tags of the body camera as transforms and as JSON."""

from __future__ import annotations

import json
from typing import Any

import cv2
import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from lupin_runtime import graph
from lupin_runtime.perception.frame_detector import FrameDetector
from lupin_runtime.perception.images import ImageError, gray_pixels
from lupin_runtime.perception.messages import tag_entry
from lupin_runtime.perception.tag_pose_estimation import Intrinsics, tag_pose
from lupin_runtime.perception.tags import make_engine
from lupin_runtime.ros import LupinNode, TransformBroadcaster, stamp_ns
from lupin_runtime.ros.tf import from_message, to_message
from lupin_runtime.transforms import TransformTree, TransformUnavailable, rotate

# After this time the assumed calibration is used for a camera that publishes images but no calibration.
CALIBRATION_WAIT_S = 2.0
# A camera that has stopped publishing for this long is reported.
SILENCE_S = 3.0


class TagAnnotator(LupinNode):
    """Finds the tags of each image and publishes, per frame, `tag_<id>` transforms and the detections as JSON.

    Only the newest image is processed: the subscription keeps one. Of the transforms it needs only `/tf_static`, which gives
    the up direction of a camera that is fixed to the base.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("tag_annotator", parameters)
        # One thread: the simulation's renderer and other processes need the cores, too.
        cv2.setNumThreads(1)
        self._edge_m = float(self.parameter("tag_edge_m", 0.1))
        self._base_frame = str(self.parameter("base_frame", graph.BASE_FRAME))
        engine = make_engine(str(self.parameter("engine", "auto")))
        self._detector = FrameDetector(engine)
        name = str(self.parameter("image_topic", graph.BODY_IMAGE_SIM.name))
        # The vendor's cameras publish best effort, which a reliable subscription would not receive.
        qos = graph.Qos(reliable=bool(self.parameter("reliable", True)), depth=1)
        image = graph.Topic(name, graph.BODY_IMAGE_SIM.type, qos)
        self._fixed = TransformTree()
        self._info: CameraInfo | None = None
        self._first_image_ns: int | None = None
        self._images = self._images_then = 0
        self._silent = False
        self._broadcaster = TransformBroadcaster(self)
        self._detections = self.publisher(graph.TAG_DETECTIONS)
        self.subscription(graph.TF_STATIC, self._on_static)
        self.subscription(graph.camera_info(image), self._on_info)
        compressed = bool(self.parameter("compressed", False))
        self.subscription(graph.compressed(image) if compressed else image, self._on_image)
        self._image_name = name
        self.create_timer(SILENCE_S, self._watch_camera)
        self.get_logger().info(f"looking for tag36h11 on {name} with {engine.name}")

    def _on_static(self, message: TFMessage) -> None:
        for item in message.transforms:
            try:
                self._fixed.insert(item.header.frame_id, item.child_frame_id, 0, from_message(item), static=True)
            except ValueError as error:
                self.get_logger().warning(f"dropped: {error}", throttle_duration_sec=5.0)

    def _on_info(self, message: CameraInfo) -> None:
        self._info = message

    def _watch_camera(self) -> None:
        """Log once when a camera stops publishing, and once when it publishes again."""
        came, self._images_then = self._images != self._images_then, self._images
        if came and self._silent:
            self.get_logger().info(f"images arrive on {self._image_name} again")
        elif not came and self._images and not self._silent:
            self.get_logger().warning(
                f"no image on {self._image_name} for {SILENCE_S:.0f} s: no tags are detected until it publishes again"
            )
        self._silent = not came and bool(self._images)

    def _on_image(self, message: Image) -> None:
        self._images += 1
        try:
            gray = gray_pixels(message)
        except ImageError as error:
            self.get_logger().warning(f"image dropped: {error}", throttle_duration_sec=5.0)
            return
        intrinsics = self._intrinsics(gray.shape[1])
        if intrinsics is None:
            return
        frame = message.header.frame_id or graph.BODY_CAMERA_FRAME
        up = self._up(frame)
        time_ns = stamp_ns(message.header.stamp)
        entries: dict[int, dict[str, Any]] = {}
        transforms: list[TransformStamped] = []
        for found in self._detector.detect(gray):
            pose = tag_pose(found.corners, intrinsics, self._edge_m, up)
            if pose is None or found.id in entries:
                continue
            entries[found.id] = tag_entry(found.id, found.corners, float(pose.translation[2]), time_ns)
            transforms.append(to_message(frame, f"{graph.TAG_FRAME_PREFIX}{found.id}", time_ns, pose.transform))
        if transforms:
            self._broadcaster.send(*transforms)
        self._detections.publish(String(data=json.dumps(list(entries.values()))))

    def _intrinsics(self, width_px: int) -> Intrinsics | None:
        """The camera's calibration; the assumed one if it has none, None while one may still arrive."""
        if self._info is not None:
            # A driver may publish smaller images than it was calibrated with.
            scale = width_px / self._info.width if self._info.width else 1.0
            k, d = np.array(self._info.k, np.float64), np.array(self._info.d, np.float64)
            try:
                found = Intrinsics.from_camera_info(k, d, self._info.width or width_px, self._info.distortion_model)
            except ValueError as error:
                self.get_logger().warning(
                    f"camera_info: {error}; tags are placed as if the lens did not distort", throttle_duration_sec=60.0
                )
                found = Intrinsics.from_camera_info(k, np.zeros(0), self._info.width or width_px)
            return found.scaled(scale)
        now_ns = self.elapsed_clock_ns()
        if self._first_image_ns is None:
            self._first_image_ns = now_ns
        if now_ns - self._first_image_ns < CALIBRATION_WAIT_S * 1e9:
            return None
        self.get_logger().warning(
            "no camera_info: distances are computed for the assumed camera (60 degrees wide)", throttle_duration_sec=60.0
        )
        return Intrinsics.fallback(width_px)

    def _up(self, frame: str) -> NDArray[np.float64] | None:
        try:
            return np.array(rotate(self._fixed.lookup(frame, self._base_frame).rotation, (0.0, 0.0, 1.0)))
        except TransformUnavailable:
            return None
