"""The nodes of perception, as the stack table imports them."""

from lupin_runtime.perception.aggregator import PerceptionAggregator
from lupin_runtime.perception.annotator import TagAnnotator
from lupin_runtime.perception.box_layout_node import BoxLayoutPublisher
from lupin_runtime.perception.flower_nodes import SimFlowerDetector, YoloDetector

__all__ = ["BoxLayoutPublisher", "PerceptionAggregator", "SimFlowerDetector", "TagAnnotator", "YoloDetector"]
