"""Subscribers of Nav2's topics receive Lupin's: no publisher offers less than Nav2's, unless a reason is written down."""

from __future__ import annotations

import pytest

from lupin_runtime import graph
from tools.nav2_qos import UPSTREAM, UpstreamPublisher


@pytest.mark.parametrize("row", UPSTREAM, ids=lambda row: row.topic.name)
def test_publisher_offers_what_nav2_offers_or_says_why_not(row: UpstreamPublisher) -> None:
    assert row.is_matched != bool(row.why_less)


@pytest.mark.parametrize("topic", graph.topics(), ids=lambda topic: topic.name)
def test_default_subscriptions_receive_all_other_topics(topic: graph.Topic) -> None:
    """rclpy's and rclcpp's default asks for a reliable publisher."""
    exceptions = {row.topic for row in UPSTREAM if row.why_less}
    assert topic.qos.reliable or topic in exceptions


def test_what_rviz_asks_to_be_latched_is_latched() -> None:
    for topic in (graph.MAP, graph.ROBOT_DESCRIPTION, graph.TF_STATIC, graph.GLOBAL_COSTMAP, graph.LOCAL_COSTMAP):
        assert topic.qos.latched


def test_table_names_each_topic_once() -> None:
    assert len({row.topic.name for row in UPSTREAM}) == len(UPSTREAM)
