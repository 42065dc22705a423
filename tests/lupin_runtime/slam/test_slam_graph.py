"""The nodes on a real graph, with a robot that replays a drive at ten times its speed."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2, quaternion_from_yaw, yaw_from_quaternion
from lupin_runtime.localization import planar_variances, says_lost
from lupin_runtime.slam.map_io import load_map, save_map
from lupin_runtime.slam.session import load_session
from tests.support.mapping_run import MappingRun
from tests.support.optional import present
from tests.support.slam_worlds import Log
from tests.support.waiting import wait_until

if TYPE_CHECKING:
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from nav2_msgs.srv import ClearEntireCostmap, ClearEntireCostmap_Response
    from nav_msgs.msg import OccupancyGrid
    from slam_toolbox.srv import SaveMap_Response
    from std_srvs.srv import Trigger_Response

    from lupin_runtime.graph import Service
    from lupin_runtime.slam.slam_node import SlamNode
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

START_NS = 1_000_000_000_000
MOUNT = Pose2(0.0, 0.0, math.pi / 2)  # the lidar faces left, so that code which ignores its mount fails


def robot_class() -> type[Any]:
    from sensor_msgs.msg import LaserScan

    from lupin_runtime.ros import LupinNode, TransformBroadcaster, TransformListener, stamp_from_ns
    from lupin_runtime.ros.tf import to_message
    from lupin_runtime.transforms import Transform

    def transform(pose: Pose2) -> Transform:
        return Transform((pose.x, pose.y, 0.0), quaternion_from_yaw(pose.yaw))

    class Replayer(LupinNode):
        """Publishes odometry and scans of a log up to `end`, and subscribes to what a console does.

        Ten times as fast as in the field while the mapper, whose newest stamp is `taken_ns()`, takes every scan; else as in the
        field: several scans that a busy machine drops in a row are a jump of the odometry.
        """

        def __init__(self, log: Log, roll: float) -> None:
            super().__init__("replayer")
            self.log, self.at, self.end = log, 0, 0
            self.is_hanging = roll == math.pi
            self.frame, self.shift_ns, self.is_ragged = graph.LASER_FRAME, 0, False
            self.taken_ns: Callable[[], float] = lambda: math.inf
            self._sent_ns = self._waited = 0
            self.maps: list[OccupancyGrid] = []
            self.poses: list[PoseWithCovarianceStamped] = []
            self._tf = TransformBroadcaster(self)
            self._scan = self.publisher(graph.SCAN)
            self.tree = TransformListener(self).tree
            self.subscription(graph.MAP, self.maps.append)
            self.subscription(graph.AMCL_POSE, self.poses.append)
            rolled = Transform(rotation=(math.sin(roll / 2.0), 0.0, 0.0, math.cos(roll / 2.0)))
            self._tf.send_static(to_message(graph.BASE_FRAME, f"/{graph.LASER_FRAME}", 0, transform(MOUNT) @ rolled))
            self.create_timer(0.01, self._step)

        def _step(self) -> None:
            if self.at >= self.end:
                return
            if self._waited < 9 and self.taken_ns() < self._sent_ns:
                self._waited += 1
                return
            self._waited = 0
            k, self.at = self.at, self.at + 1
            stamp = self._sent_ns = START_NS + self.shift_ns + k * 100_000_000
            self._tf.send(to_message(graph.ODOM_FRAME, graph.BASE_FRAME, stamp, transform(self.odom(k))))
            step = float(self.log.angles[1] - self.log.angles[0])
            message = LaserScan(range_min=0.03, range_max=12.0, angle_increment=step)
            message.angle_min = float(self.log.angles[0]) - MOUNT.yaw
            message.header.stamp, message.header.frame_id = stamp_from_ns(stamp), self.frame
            message.ranges = array("f", self.log.ranges[k].astype(np.float32).tobytes())
            if self.is_hanging:
                message.angle_min = MOUNT.yaw - float(self.log.angles[-1])
                message.ranges = message.ranges[::-1]
                message.range_max = 0.0  # as a driver that states no limit
            if self.is_ragged:
                message.ranges = message.ranges[: 0 if k % 11 == 5 else len(message.ranges) - k % 4]
            self._scan.publish(message)

        def odom(self, k: int) -> Pose2:
            return Pose2(*(float(v) for v in self.log.odom[k]))

        def truth(self, k: int) -> Pose2:
            """Return the true pose at scan `k`, relative to the start."""
            return Pose2(*self.log.truth[0]).inverse() @ Pose2(*self.log.truth[k])

        def map_from_odom(self) -> Pose2 | None:
            """Return the present correction, as subscribers see it."""
            try:
                return self.tree.lookup(graph.MAP_FRAME, graph.ODOM_FRAME).to_pose2()
            except LookupError:
                return None

        def error_m(self) -> float:
            """Return the distance between the robot's estimated and true position, m."""
            offset = self.map_from_odom()
            k = self.at - 1
            return math.inf if offset is None else (offset @ self.odom(k)).distance_to(self.truth(k))

    return Replayer


@pytest.fixture
def robot(graph_host: GraphHost, greenhouse_log: Log) -> Any:
    return replay(graph_host, greenhouse_log)


@pytest.fixture
def hanging_robot(graph_host: GraphHost, greenhouse_log: Log) -> Any:
    """A robot whose lidar hangs upside down."""
    return replay(graph_host, greenhouse_log, math.pi)


def replay(graph_host: GraphHost, log: Log, roll: float = 0.0) -> Any:
    """Return a robot that replays a log; `play(to)` waits until it has published that scan."""
    replayer = graph_host.add(robot_class()(log, roll))

    def play(to: int) -> None:
        replayer.end = to
        graph_host.until(lambda: replayer.at == to, what=f"scan {to}")

    replayer.play = play
    return replayer


def mapper(graph_host: GraphHost, robot: Any, parameters: dict[str, Any]) -> SlamNode:
    """Start a mapper and wait until it has received the lidar's mount, which is published once."""
    from lupin_runtime.slam.slam_node import SlamNode

    node: SlamNode = graph_host.add(SlamNode(parameters))
    graph_host.until(lambda: robot.count_subscribers(graph.SCAN.name) and robot.count_subscribers(graph.TF.name) > 1)

    def has_the_mount() -> bool:
        try:
            node._tree.lookup(graph.BASE_FRAME, graph.LASER_FRAME)
        except LookupError:
            return False
        return True

    graph_host.until(has_the_mount, what="the lidar's mount")
    robot.taken_ns = lambda: node._last_stamp_ns
    return node


@pytest.fixture
def slam(graph_host: GraphHost, robot: Any) -> SlamNode:
    return mapper(graph_host, robot, {"map_update_interval": 0.5, "transform_publish_period": 0.02})


def call(host: GraphHost, node: Any, row: Service, request: pytest.FixtureRequest) -> SaveMap_Response | Trigger_Response:
    client = node.client(row)
    host.until(client.service_is_ready, what=f"{row.name}'s server")
    future = client.call_async(request)
    return host.until(lambda: future.done() and future.result(), what=f"{row.name}'s answer")


@pytest.mark.usefixtures("slam")
def test_drive_gives_a_map_and_a_true_transform(graph_host: GraphHost, robot: Any) -> None:
    robot.play(150)
    graph_host.until(lambda: robot.error_m() < 0.05, what="a true pose")
    message = graph_host.until(lambda: robot.maps and robot.maps[-1], what="a map")
    assert message.header.frame_id == graph.MAP_FRAME
    assert message.info.resolution == pytest.approx(0.05)
    cells = np.frombuffer(message.data, np.int8).reshape(message.info.height, message.info.width)
    assert set(np.unique(cells)) == {-1, 0, 100}
    # The room is 9 x 7 m, and the robot started 1 m and 0.7 m from its corner.
    column, row = (np.array([-0.5, -0.35]) - [message.info.origin.position.x, message.info.origin.position.y]) / 0.05
    assert cells[int(row), int(column)] == 0
    assert message.info.origin.position.x == pytest.approx(-1.0, abs=0.15)


def test_late_subscriber_gets_the_latched_map(graph_host: GraphHost, robot: Any) -> None:
    from lupin_runtime.ros import LupinNode

    mapper(graph_host, robot, {"map_update_interval": 1000.0})
    robot.play(30)
    graph_host.until(lambda: robot.maps, what="the map of the first scan")
    late: list[OccupancyGrid] = []
    listener = LupinNode("late")
    listener.subscription(graph.MAP, late.append)
    graph_host.add(listener)
    graph_host.until(lambda: late, what="the latched map")
    assert late == robot.maps and len(late) == 1


def test_lidar_that_hangs_upside_down_gives_a_true_map(graph_host: GraphHost, hanging_robot: Any) -> None:
    """With a leading slash in the scans' frame, some scans empty, and others of varying counts."""
    mapper(graph_host, hanging_robot, {"map_update_interval": 0.5, "transform_publish_period": 0.02})
    hanging_robot.frame, hanging_robot.is_ragged = f"/{graph.LASER_FRAME}", True
    hanging_robot.play(150)
    graph_host.until(lambda: hanging_robot.error_m() < 0.05, what="a true pose")
    message = graph_host.until(lambda: hanging_robot.maps and hanging_robot.maps[-1], what="a map")
    cells = np.frombuffer(message.data, np.int8).reshape(message.info.height, message.info.width)
    column, row = (np.array([-0.5, -0.35]) - [message.info.origin.position.x, message.info.origin.position.y]) / 0.05
    assert cells[int(row), int(column)] == 0
    assert message.info.origin.position.x == pytest.approx(-1.0, abs=0.15)


def test_tilted_lidar_maps_nothing(graph_host: GraphHost, greenhouse_log: Log) -> None:
    tilted = replay(graph_host, greenhouse_log, math.radians(30.0))
    mapper(graph_host, tilted, {"map_update_interval": 0.1})
    tilted.play(30)
    assert tilted.map_from_odom() is None and not tilted.maps


@pytest.mark.usefixtures("slam")
def test_dynamic_map_is_the_present_map(graph_host: GraphHost, robot: Any) -> None:
    from lifecycle_msgs.srv import GetState
    from nav_msgs.srv import GetMap

    state: Any = call(graph_host, robot, graph.SLAM_STATE, GetState.Request())
    assert state.current_state.label == "active"
    empty: Any = call(graph_host, robot, graph.SLAM_DYNAMIC_MAP, GetMap.Request())
    assert (empty.map.info.width, len(empty.map.data)) == (0, 0)
    robot.play(60)
    graph_host.until(lambda: robot.maps)
    response: Any = call(graph_host, robot, graph.SLAM_DYNAMIC_MAP, GetMap.Request())
    info = response.map.info
    assert response.map.header.frame_id == graph.MAP_FRAME
    assert len(response.map.data) == info.width * info.height > 1_000
    assert 100 in response.map.data


@pytest.mark.usefixtures("slam")
def test_transform_is_dated_ahead_so_that_now_can_be_looked_up(graph_host: GraphHost, robot: Any) -> None:
    robot.play(30)
    graph_host.until(lambda: robot.map_from_odom() is not None)
    newest = robot.tree.newest_ns(graph.MAP_FRAME, graph.ODOM_FRAME)
    assert newest > robot.now_ns()


@pytest.mark.usefixtures("slam")
def test_save_map_writes_the_file_or_reports_a_bad_path(graph_host: GraphHost, robot: Any, tmp_path: Path) -> None:
    from slam_toolbox.srv import SaveMap

    request = SaveMap.Request()
    request.name.data = str(tmp_path / "house")
    assert call(graph_host, robot, graph.SLAM_SAVE_MAP, request).result == SaveMap.Response.RESULT_NO_MAP_RECEIEVD
    robot.play(60)
    graph_host.until(lambda: robot.maps)
    assert call(graph_host, robot, graph.SLAM_SAVE_MAP, request).result == SaveMap.Response.RESULT_SUCCESS
    assert (load_map(tmp_path / "house.yaml").cells == 100).sum() > 200
    for bad in (str(tmp_path / "nowhere" / "house"), "~nobody-of-that-name/house", "/"):
        request.name.data = bad
        assert call(graph_host, robot, graph.SLAM_SAVE_MAP, request).result == SaveMap.Response.RESULT_UNDEFINED_FAILURE


def test_saved_graph_is_loaded_and_a_damaged_one_changes_nothing(
    graph_host: GraphHost, robot: Any, slam: SlamNode, tmp_path: Path
) -> None:
    from slam_toolbox.srv import DeserializePoseGraph, SerializePoseGraph

    robot.play(60)
    graph_host.until(lambda: robot.maps)
    saved = SerializePoseGraph.Request(filename=str(tmp_path / "house"))
    assert call(graph_host, robot, graph.SLAM_SERIALIZE, saved).result == SerializePoseGraph.Response.RESULT_SUCCESS
    (tmp_path / "damaged.posegraph").write_bytes((tmp_path / "house.posegraph").read_bytes()[:1000])
    before = slam._mapper
    for name in ("damaged", "absent"):
        call(graph_host, robot, graph.SLAM_DESERIALIZE, DeserializePoseGraph.Request(filename=str(tmp_path / name)))
        assert slam._mapper is before
    at = DeserializePoseGraph.Request.START_AT_GIVEN_POSE
    request = DeserializePoseGraph.Request(filename=str(tmp_path / "house"), match_type=at)
    request.initial_pose.x = 0.5
    call(graph_host, robot, graph.SLAM_DESERIALIZE, request)
    # Scans that were under way when the graph was saved may have been added since, here as in the graph before.
    assert slam._mapper is not before and len(slam._mapper.graph) >= len(load_session(tmp_path / "house.posegraph").graph) > 1


@pytest.mark.usefixtures("slam")
def test_clear_map_restarts_the_map_and_clears_both_costmaps(graph_host: GraphHost, robot: Any) -> None:
    from std_srvs.srv import Trigger

    from lupin_runtime.ros import LupinNode
    from lupin_runtime.slam.node import SlamResetNode

    cleared = []
    costmaps = LupinNode("costmaps")

    def clear(
        name: str, _request: ClearEntireCostmap.Request, response: ClearEntireCostmap.Response
    ) -> ClearEntireCostmap_Response:
        cleared.append(name)
        return response

    costmaps.service(graph.CLEAR_LOCAL_COSTMAP, lambda q, r: clear("local", q, r))
    costmaps.service(graph.CLEAR_GLOBAL_COSTMAP, lambda q, r: clear("global", q, r))
    graph_host.add(costmaps)
    graph_host.add(SlamResetNode())
    robot.play(120)
    graph_host.until(lambda: robot.error_m() < 0.05)

    def began_at_one_of(scans: range) -> bool:
        return any((robot.map_from_odom() @ robot.odom(scan)).distance_to(Pose2()) < 0.05 for scan in scans)

    assert not began_at_one_of(range(100, 120))
    answer = call(graph_host, robot, graph.CLEAR_MAP, Trigger.Request())
    assert answer.success and "2 of 2" in answer.message
    graph_host.until(lambda: sorted(cleared) == ["global", "local"])
    seen = len(robot.maps)
    # The first scan with odometry has the new origin: on a busy machine one that was published before the reset.
    robot.end = 160
    graph_host.until(lambda: began_at_one_of(range(100, robot.at)), what="a new origin")
    graph_host.until(lambda: len(robot.maps) > seen, what="a new map")


def test_clear_map_without_slam_fails_in_bounded_time(graph_host: GraphHost, robot: Any) -> None:
    from std_srvs.srv import Trigger

    from lupin_runtime.slam.node import SlamResetNode

    graph_host.add(SlamResetNode())
    answer = call(graph_host, robot, graph.CLEAR_MAP, Trigger.Request())
    assert not answer.success
    assert graph.SLAM_RESET.name in answer.message


@pytest.mark.usefixtures("slam")
def test_scans_in_an_unknown_frame_are_dropped(graph_host: GraphHost, robot: Any) -> None:
    robot.frame = "another_laser"
    robot.play(20)
    robot.frame = graph.LASER_FRAME
    assert robot.map_from_odom() is None and not robot.maps
    robot.play(60)
    graph_host.until(lambda: robot.maps, what="a map from the right frame")


def test_clock_stepping_back_keeps_the_map_and_continues(graph_host: GraphHost, robot: Any, slam: SlamNode) -> None:
    robot.play(100)
    graph_host.until(lambda: robot.error_m() < 0.05)
    robot.tree.clear()
    robot.shift_ns = -500_000_000_000
    # At the pace of the field: a scan beside odometry from before the step is dropped, and the next one fits the motion since.
    after_step = "a scan after the step"
    wait_until(lambda: 0 < slam._last_stamp_ns < START_NS, after_step, interval_s=0.1, each=lambda: _played(robot, 1))
    robot.play(200)
    graph_host.until(lambda: robot.error_m() < 0.05, what="the pose after the step")
    width = graph_host.until(lambda: robot.maps[-1]).info.width * 0.05
    assert width > 8.0  # still the whole room, not a new map


def test_killed_node_resumes_its_session(
    graph_host: GraphHost, robot: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from lupin_runtime.slam import slam_node

    monkeypatch.setattr(slam_node, "SESSION_PERIOD_S", 0.2)
    session = tmp_path / "slam.posegraph"
    parameters = {"map_update_interval": 0.5, "session_file": str(session)}
    first = mapper(graph_host, robot, parameters)
    robot.play(250)
    graph_host.until(lambda: robot.error_m() < 0.05)
    graph_host.until(session.exists)
    written = session.stat().st_mtime_ns
    graph_host.until(lambda: session.stat().st_mtime_ns > written, what="a session of the newest map")
    graph_host.remove(first)
    graph_host.until(lambda: not robot.count_subscribers(graph.SCAN.name))
    robot.tree.clear()
    robot.maps.clear()
    mapper(graph_host, robot, parameters)
    robot.play(330)
    graph_host.until(lambda: robot.error_m() < 0.05, what="the old map's frame")
    assert graph_host.until(lambda: robot.maps and robot.maps[-1]).info.width * 0.05 > 8.0


def test_corrupt_session_starts_a_new_map_with_a_warning(graph_host: GraphHost, robot: Any, tmp_path: Path) -> None:
    session = tmp_path / "slam.posegraph"
    session.write_bytes(b"not a session")
    mapper(graph_host, robot, {"session_file": str(session)})
    robot.play(40)
    graph_host.until(lambda: robot.error_m() < 0.05)


# -- localization ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def saved_map(mapped: MappingRun, tmp_path: Path) -> Path:
    save_map(tmp_path / "house.yaml", present(mapped.mapper.grid()))
    return tmp_path / "house.yaml"


def test_amcl_finds_the_robot_and_covers_its_error(graph_host: GraphHost, robot: Any, saved_map: Path) -> None:
    from lifecycle_msgs.srv import GetState

    from lupin_runtime.slam.node import AmclNode, MapServer

    graph_host.add(MapServer({"yaml_filename": str(saved_map)}))
    graph_host.add(AmclNode({"initial_pose.x": 0.2, "initial_pose.y": -0.15, "initial_pose.yaw": 0.1}))
    graph_host.until(lambda: robot.maps and robot.count_subscribers(graph.SCAN.name))
    for row in (graph.AMCL_STATE, graph.MAP_SERVER_STATE):
        state: Any = call(graph_host, robot, row, GetState.Request())
        assert state.current_state.label == "active"
    robot.play(200)
    graph_host.until(lambda: robot.error_m() < 0.06, what="a true pose")
    message = graph_host.until(lambda: robot.poses and robot.poses[-1])
    assert message.header.frame_id == graph.MAP_FRAME
    covariance = np.asarray(message.pose.covariance).reshape(6, 6)[np.ix_((0, 1, 5), (0, 1, 5))]
    assert (np.linalg.eigvalsh(covariance) > 0.0).all()
    stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
    k = round((stamp - START_NS) / 1e8)
    at, q = message.pose.pose.position, message.pose.pose.orientation
    truth = robot.truth(k)
    error = np.array([at.x - truth.x, at.y - truth.y, yaw_from_quaternion(q.x, q.y, q.z, q.w) - truth.yaw])
    error[2] = (error[2] + math.pi) % (2 * math.pi) - math.pi
    assert error @ np.linalg.solve(covariance, error) < 16.3  # 99.9 % of chi-squared with three degrees of freedom
    assert robot.tree.newest_ns(graph.MAP_FRAME, graph.ODOM_FRAME) >= stamp + 900_000_000


def test_amcl_knows_a_lidar_that_hangs_upside_down(graph_host: GraphHost, hanging_robot: Any, saved_map: Path) -> None:
    from lupin_runtime.slam.node import AmclNode, MapServer

    hanging_robot.frame, hanging_robot.is_ragged = f"/{graph.LASER_FRAME}", True
    graph_host.add(MapServer({"yaml_filename": str(saved_map)}))
    graph_host.add(AmclNode({"initial_pose.x": 0.2, "initial_pose.y": -0.15, "initial_pose.yaw": 0.1}))
    graph_host.until(lambda: hanging_robot.maps and hanging_robot.count_subscribers(graph.SCAN.name))
    hanging_robot.play(200)
    graph_host.until(lambda: hanging_robot.error_m() < 0.06, what="a true pose")


def test_initial_pose_is_accepted_in_the_map_frame_only(graph_host: GraphHost, robot: Any, saved_map: Path) -> None:
    from geometry_msgs.msg import PoseWithCovarianceStamped

    from lupin_runtime.slam.node import AmclNode, MapServer

    graph_host.add(MapServer({"yaml_filename": str(saved_map)}))
    graph_host.add(AmclNode({"initial_pose.x": 6.0, "initial_pose.y": 5.0}))  # far away
    graph_host.until(lambda: robot.maps and robot.count_subscribers(graph.SCAN.name))
    publisher = robot.publisher(graph.INITIAL_POSE)
    graph_host.until(publisher.get_subscription_count)
    robot.play(30)
    graph_host.until(lambda: robot.poses and robot.error_m() > 1.0)

    def publish_pose(frame: str, x: float) -> None:
        message = PoseWithCovarianceStamped()
        message.header.frame_id = frame
        message.pose.pose.position.x = robot.truth(robot.at - 1).x + x
        message.pose.pose.position.y = robot.truth(robot.at - 1).y
        _, _, message.pose.pose.orientation.z, message.pose.pose.orientation.w = quaternion_from_yaw(
            robot.truth(robot.at - 1).yaw
        )
        publisher.publish(message)

    publish_pose("odom", 0.0)
    robot.play(60)
    assert robot.error_m() > 1.0
    publish_pose(graph.MAP_FRAME, math.nan)
    robot.play(80)
    assert robot.error_m() > 1.0
    publish_pose(graph.MAP_FRAME, 0.1)
    graph_host.until(lambda: _played(robot, 1) and robot.error_m() < 0.08, what="the robot where it was said to be")


def test_amcl_says_that_a_robot_off_its_map_is_lost(graph_host: GraphHost, robot: Any, tmp_path: Path) -> None:
    from lupin_runtime.slam.node import AmclNode, MapServer

    save_map(tmp_path / "part.yaml", present(MappingRun(robot.log).process(0, 60).mapper.grid()))
    graph_host.add(MapServer({"yaml_filename": str(tmp_path / "part.yaml")}))
    graph_host.add(AmclNode({"initial_pose.x": 0.0, "initial_pose.y": 0.0}))
    graph_host.until(lambda: robot.maps and robot.count_subscribers(graph.SCAN.name))
    robot.play(40)
    graph_host.until(lambda: robot.error_m() < 0.06, what="a true pose")
    graph_host.until(lambda: _played(robot, 1) and _is_lost(robot), what="the lost robot")
    assert robot.error_m() < 0.2, "the last correction, from before the robot was lost"
    newest = robot.tree.newest_ns(graph.MAP_FRAME, graph.ODOM_FRAME)
    robot.play(robot.at + 50)
    assert robot.tree.newest_ns(graph.MAP_FRAME, graph.ODOM_FRAME) == newest, "a lost robot has no place in the map"
    assert _is_lost(robot)


def test_killed_amcl_goes_on_where_it_was(graph_host: GraphHost, robot: Any, saved_map: Path, tmp_path: Path) -> None:
    from lupin_runtime.slam.node import AmclNode, MapServer

    parameters = {"initial_pose.x": 0.0, "initial_pose.y": 0.0, "state_file": str(tmp_path / "localization.json")}
    graph_host.add(MapServer({"yaml_filename": str(saved_map)}))
    first = graph_host.add(AmclNode(parameters))
    graph_host.until(lambda: robot.maps and robot.count_subscribers(graph.SCAN.name))
    robot.play(200)
    graph_host.until(lambda: robot.error_m() < 0.06, what="a true pose")
    assert robot.truth(199).distance_to(Pose2()) > 1.0, "far from the initial pose"
    _replace(graph_host, robot, first, lambda: AmclNode(parameters))
    graph_host.until(lambda: _played(robot, 1) and robot.map_from_odom(), what="the first transform")
    assert robot.error_m() < 0.1


def test_killed_amcl_does_not_forget_that_the_robot_is_lost(graph_host: GraphHost, robot: Any, tmp_path: Path) -> None:
    from lupin_runtime.slam.node import AmclNode, MapServer

    parameters = {"initial_pose.x": 0.0, "initial_pose.y": 0.0, "state_file": str(tmp_path / "localization.json")}
    save_map(tmp_path / "part.yaml", present(MappingRun(robot.log).process(0, 60).mapper.grid()))
    graph_host.add(MapServer({"yaml_filename": str(tmp_path / "part.yaml")}))
    first = graph_host.add(AmclNode(parameters))
    graph_host.until(lambda: robot.maps and robot.count_subscribers(graph.SCAN.name))
    graph_host.until(lambda: _played(robot, 1) and _is_lost(robot), what="the lost robot")
    _replace(graph_host, robot, first, lambda: AmclNode(parameters))
    graph_host.until(lambda: _played(robot, 1) and robot.poses, what="the first pose")
    assert all(says_lost(planar_variances(pose)) for pose in robot.poses)
    assert robot.map_from_odom() is None, "a lost robot has no place in the map"


def _replace(graph_host: GraphHost, robot: Any, old: Any, make: Callable[[], Any]) -> None:
    """Remove the old node, forget what it published, and start the new one."""
    graph_host.remove(old)
    graph_host.until(lambda: not robot.count_subscribers(graph.SCAN.name))
    robot.tree.clear()
    robot.poses.clear()
    graph_host.add(make())
    graph_host.until(lambda: robot.count_subscribers(graph.SCAN.name))


def test_amcl_finds_a_robot_when_the_crowd_around_it_leaves(
    graph_host: GraphHost, greenhouse_log: Log, saved_map: Path
) -> None:
    from lupin_runtime.slam.node import AmclNode, MapServer

    robot = replay(graph_host, _with_crowd(greenhouse_log, surrounded=range(60, 360), rest=200, scans=800))
    graph_host.add(MapServer({"yaml_filename": str(saved_map)}))
    graph_host.add(AmclNode({"initial_pose.x": 0.0, "initial_pose.y": 0.0}))
    graph_host.until(lambda: robot.maps and robot.count_subscribers(graph.SCAN.name))
    robot.play(360)
    assert graph_host.until(lambda: _is_lost(robot), what="the lost robot")
    graph_host.until(lambda: _played(robot, 1) and not _is_lost(robot) and robot.error_m() < 0.06, what="the found robot")


def _with_crowd(log: Log, surrounded: range, rest: int, scans: int) -> Log:
    """Return a log of a robot that people surround during some scans, and that rests from scan `rest` on."""
    index = np.minimum(np.arange(scans), rest)
    ranges = log.ranges[index].copy()
    rng = np.random.default_rng(5)
    ranges += rng.normal(0.0, 0.002, ranges.shape)  # no two scans are the same
    ranges[surrounded] = rng.uniform(0.5, 0.9, (len(surrounded), ranges.shape[1]))
    return Log(np.linspace(0.0, 0.1 * (scans - 1), scans), log.truth[index], log.odom[index], ranges, log.angles)


def _is_lost(robot: Any) -> bool:
    return bool(robot.poses) and says_lost(planar_variances(robot.poses[-1]))


def _played(robot: Any, scans: int) -> bool:
    robot.end = min(robot.at + scans, len(robot.log.stamps))
    return True


def test_map_server_changes_the_map_and_keeps_it_if_unreadable(
    graph_host: GraphHost, robot: Any, saved_map: Path, tmp_path: Path
) -> None:
    from nav2_msgs.srv import LoadMap
    from nav_msgs.srv import GetMap

    from lupin_runtime.gridmap import GridMap
    from lupin_runtime.slam.node import MapServer

    graph_host.add(MapServer({"yaml_filename": str(saved_map), "map_update_interval": 1000.0}))
    save_map(tmp_path / "small room.yaml", GridMap(np.zeros((20, 30), np.int8), 0.05, -1.0, -0.5))
    (tmp_path / "broken.yaml").write_text("image: m.pgm\nresolution: nothing\n")
    url = (tmp_path / "small room.yaml").as_uri()
    response: Any = call(graph_host, robot, graph.MAP_SERVER_LOAD_MAP, LoadMap.Request(map_url=url))
    assert (response.result, response.map.info.width) == (LoadMap.Response.RESULT_SUCCESS, 30)
    graph_host.until(lambda: robot.maps and robot.maps[-1].info.width == 30, what="the new map")
    for name, result in (
        (str(tmp_path / "absent.yaml"), LoadMap.Response.RESULT_MAP_DOES_NOT_EXIST),
        ("package://maps/house.yaml", LoadMap.Response.RESULT_MAP_DOES_NOT_EXIST),
        (str(tmp_path / "broken.yaml"), LoadMap.Response.RESULT_INVALID_MAP_DATA),
    ):
        response = call(graph_host, robot, graph.MAP_SERVER_LOAD_MAP, LoadMap.Request(map_url=name))
        assert response.result == result
    served: Any = call(graph_host, robot, graph.MAP_SERVER_MAP, GetMap.Request())
    assert (served.map.info.width, served.map.info.height) == (30, 20)


@pytest.mark.usefixtures("graph_host")
def test_map_server_refuses_an_unreadable_map_by_line(tmp_path: Path) -> None:
    from lupin_runtime.slam.node import MapServer

    (tmp_path / "m.yaml").write_text("image: m.pgm\nresolution: nothing\n")
    with pytest.raises(ValueError, match=r"m.yaml"):
        MapServer({"yaml_filename": str(tmp_path / "m.yaml")})
    with pytest.raises(ValueError, match="yaml_filename"):
        MapServer()
