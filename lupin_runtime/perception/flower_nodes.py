"""Nodes `sim_flower_detector` and `yolo_detector`: flowers and bugs of the gripper camera on `/yolo/detections`."""

from __future__ import annotations

import json
from array import array
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import String

from lupin_runtime import graph
from lupin_runtime.perception.color_blobs import CLASS_NAMES, BlobLimits, find_flowers
from lupin_runtime.perception.images import ImageError, bgr_pixels
from lupin_runtime.perception.messages import FlowerDetection, flower_entry
from lupin_runtime.ros import LupinNode

_CLASS_BGR = ((58, 58, 226), (238, 232, 232), (166, 106, 236), (20, 20, 20))


class DetectorUnavailable(RuntimeError):
    """A flower detector that cannot run; the message names what is missing and the command that installs it."""


def detections_message(detections: Sequence[FlowerDetection], names: Sequence[str] = CLASS_NAMES) -> String:
    """The JSON of `/yolo/detections`."""
    named = (flower_entry(b, names[b.class_id] if 0 <= b.class_id < len(names) else str(b.class_id)) for b in detections)
    return String(data=json.dumps(list(named)))


def draw(bgr: NDArray[np.uint8], detections: Sequence[FlowerDetection]) -> NDArray[np.uint8]:
    """A copy of the image with a box and a confidence for each detection."""
    shown = np.ascontiguousarray(bgr).copy()
    for detection in detections:
        x1, y1, x2, y2 = (round(value) for value in detection.box_px)
        color = _CLASS_BGR[detection.class_id % len(_CLASS_BGR)]
        cv2.rectangle(shown, (x1, y1), (x2, y2), color, 2)
        label = f"{CLASS_NAMES[detection.class_id]} {detection.confidence:.2f}"
        cv2.putText(shown, label, (x1, max(12, y1 - 4)), cv2.FONT_HERSHEY_SIMPLEX, 0.4, color, 1)
    return shown


def image_message(source: Image | CompressedImage, bgr: NDArray[np.uint8]) -> Image:
    """A bgr8 image with the header of the one it was drawn on."""
    height, width = bgr.shape[:2]
    data = array("B")
    data.frombytes(np.ascontiguousarray(bgr).tobytes())
    return Image(header=source.header, height=height, width=width, encoding="bgr8", step=3 * width, data=data)


class SimFlowerDetector(LupinNode):
    """Replaces the trained detector in the simulation, where that detects nothing: it finds blobs of color."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("sim_flower_detector", parameters)
        cv2.setNumThreads(1)
        self._limits = BlobLimits(
            float(self.parameter("min_area_px", 150.0)),
            float(self.parameter("conf_area_px", 2000.0)),
            int(self.parameter("morph_kernel", 5)),
        )
        self._wants_overlay = bool(self.parameter("publish_overlay", True))
        self._detections = self.publisher(graph.FLOWER_DETECTIONS)
        self._overlay = self.publisher(graph.FLOWER_OVERLAY) if self._wants_overlay else None
        topic = str(self.parameter("image_topic", graph.GRIPPER_IMAGE.name))
        self.subscription(graph.Topic(topic, graph.GRIPPER_IMAGE.type, graph.GRIPPER_IMAGE.qos), self._on_image)

    def _on_image(self, message: Image) -> None:
        try:
            bgr = bgr_pixels(message)
        except ImageError as error:
            self.get_logger().warning(f"image dropped: {error}", throttle_duration_sec=5.0)
            return
        detections = find_flowers(bgr, self._limits)
        if detections:
            self._detections.publish(detections_message(detections))
        if self._overlay is not None and self._overlay.get_subscription_count() > 0:
            self._overlay.publish(image_message(message, draw(bgr, detections)))


class YoloDetector(LupinNode):
    """The trained detector of the real robot; needs the package `ultralytics`, which the operator installs."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("yolo_detector", parameters)
        model_path = str(self.parameter("model_path", ""))
        self._confidence = float(self.parameter("conf", 0.25))
        self._image_px = int(self.parameter("imgsz", 640))
        self._track = bool(self.parameter("track", True))
        self._model = load_model(model_path)
        self._detections = self.publisher(graph.FLOWER_DETECTIONS)
        self._annotated = self.publisher(graph.YOLO_OVERLAY)
        self.subscription(graph.compressed(graph.GRIPPER_IMAGE), self._on_image)

    def _on_image(self, message: CompressedImage) -> None:
        try:
            bgr = bgr_pixels(message)
        except ImageError as error:
            self.get_logger().warning(f"image dropped: {error}", throttle_duration_sec=5.0)
            return
        options = {"conf": self._confidence, "imgsz": self._image_px, "verbose": False}
        results = self._model.track(bgr, persist=True, **options) if self._track else self._model(bgr, **options)
        detections = detections_from_boxes(results[0].boxes)
        if detections:
            self._detections.publish(detections_message(detections))
        if self._annotated.get_subscription_count() > 0:
            self._annotated.publish(image_message(message, results[0].plot()))


def load_model(model_path: str) -> Any:
    """Load a weights file. Raises DetectorUnavailable if the package or the file is missing: a detector that started without
    its library would look healthy and detect nothing."""
    try:
        from ultralytics import YOLO
    except ImportError as error:
        raise DetectorUnavailable(
            "yolo_detector needs the package ultralytics, which is not installed; run: pip install ultralytics 'numpy<2'  "
            "(or start without it: --no-yolo)"
        ) from error
    if not Path(model_path).is_file():
        raise DetectorUnavailable(
            f"yolo_detector's parameter model_path is {model_path!r}, which is not a file; set it to the weights"
        )
    return YOLO(model_path)


def detections_from_boxes(boxes: Any) -> list[FlowerDetection]:
    """Detections of an ultralytics `Boxes`: `cls`, `conf`, `xyxy`, and `id` where a tracker ran."""
    tracks = boxes.id.tolist() if boxes.id is not None else [None] * len(boxes.cls)
    return [
        FlowerDetection(int(c), float(p), (float(b[0]), float(b[1]), float(b[2]), float(b[3])), None if t is None else int(t))
        for c, p, b, t in zip(boxes.cls.tolist(), boxes.conf.tolist(), boxes.xyxy.tolist(), tracks)
    ]
