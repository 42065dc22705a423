"""`pad_teleop`: drives and moves the arm with a gamepad that is connected to this computer."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.timer import Timer
from sensor_msgs.msg import Joy

from lupin_runtime import graph
from lupin_runtime.drive import ZERO, encode
from lupin_runtime.json_text import conform, parse_json
from lupin_runtime.ros import LupinNode, stamp_from_ns
from lupin_runtime.ros.wake import Wake
from lupin_runtime.teleop.arm_jogger import AT_REST, ArmJogger
from lupin_runtime.teleop.connected_pads import DEVICES, SCAN_PERIOD_S, SYSFS, ConnectedPads
from lupin_runtime.teleop.jog_publisher import JogPublisher
from lupin_runtime.teleop.map_files import map_folder
from lupin_runtime.teleop.pad_driver import PadDriver
from lupin_runtime.teleop.pad_selection import MIN_PERIOD_S, PERIOD_S
from lupin_runtime.teleop.pad_state import DeadMan, PadState
from lupin_runtime.teleop.readable_watch import ReadableWatch
from lupin_runtime.teleop.rumble import AlertRules, Rumbles

# A pad that floods is read this often between two ticks, and then only at the next one.
_MAX_WAKES_PER_TICK = 25


class PadTeleop(LupinNode):
    """The node of the gamepads. Everything but the waiting happens in its executor: if that hangs, nothing is published.

    Parameters: `devices` and `sysfs`, the folders in which input devices are found; `maps`, that of the calibrated pads;
    `onboard`, whether this computer is the robot's.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("pad_teleop", parameters)
        log = self.get_logger()
        devices, sysfs = Path(self.parameter("devices", str(DEVICES))), Path(self.parameter("sysfs", str(SYSFS)))
        maps = Path(self.parameter("maps", str(map_folder())))
        on_robot = self.parameter("onboard", False)
        self._pads = ConnectedPads(devices, sysfs, maps=maps, inform=log.info, warn=log.warning, on_robot=on_robot)
        self._driver, self._jogger = PadDriver(), ArmJogger()
        self._alerts, self._rumbles = AlertRules(), Rumbles(devices, sysfs, log.info)
        self._wakes = 0
        self._closed = False
        self._velocity = self.publisher(graph.CMD_VEL_JOY)
        self._rates = JogPublisher(self)
        self._joy = self.publisher(graph.JOY)
        self.subscription(graph.DRIVE_STATUS, self._on_status)
        self.subscription(graph.ARM_STATUS, self._on_arm_status)
        self._watch = ReadableWatch(Wake(self, self._on_wake).trigger)
        # Steady time: a pad's dead-man button does not follow the simulation's clock.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._tick: Timer = self.create_timer(PERIOD_S, self._on_tick, clock=steady)
        self._tick.cancel()  # it runs while a pad is connected
        self._soon: Timer = self.create_timer(MIN_PERIOD_S, self._on_soon, clock=steady)
        self._soon.cancel()  # it runs once after a change that came too soon after another
        self.create_timer(SCAN_PERIOD_S, self._scan, clock=steady)
        self._scan()

    def before_shutdown(self) -> None:
        """Publish a last zero if a pad drives, and if one moves the arm."""
        self._closed = True
        if self._driver.driving is not None:
            self._velocity.publish(encode(ZERO))
        if self._jogger.jogging is not None:
            self._rates.publish([AT_REST])

    def destroy_node(self) -> None:
        """Close the pads, and leave the graph."""
        self._watch.close()
        self._rumbles.close()
        self._pads.close()
        super().destroy_node()

    def _scan(self) -> None:
        self._pads.scan(self.monotonic_ns())
        if self._pads.pads and self._tick.is_canceled():
            self._tick.reset()
            self._rearm()

    def _on_wake(self) -> None:
        self._wakes += 1
        self._step()
        if self._wakes < _MAX_WAKES_PER_TICK:
            self._rearm()

    def _on_tick(self) -> None:
        self._wakes = 0
        self._step()
        self._rearm()
        self._publish_joy()
        self._rumble()
        if not self._pads.pads:
            self._tick.cancel()

    def _on_soon(self) -> None:
        self._soon.cancel()
        self._step()

    def _rearm(self) -> None:
        for pad in self._pads.pads.values():
            self._watch.watch(pad.device.file)

    def _step(self) -> None:
        now_ns = self.monotonic_ns()
        self._pads.read(now_ns)
        velocity = self._driver.step(self._pads.states, now_ns)
        if velocity is not None and not self._closed:
            self._velocity.publish(encode(velocity))
        rates = self._jogger.step(self._pads.states, self._driver.driving, now_ns)
        if not self._closed:
            self._rates.publish(rates)
        if (self._driver.delayed or self._jogger.delayed) and self._soon.is_canceled():
            self._soon.reset()

    def _on_status(self, message: Any) -> None:
        with suppress(ValueError):  # another program's: the bus itself does not listen to this node
            status = parse_json(message.data)
            locks = conform(status, {"locks": [""]})["locks"]
            self._alerts.handle_status(locks, self.monotonic_ns())

    def _on_arm_status(self, message: Any) -> None:
        with suppress(ValueError):  # another program's
            self._alerts.handle_arm(conform(parse_json(message.data), {"jog_refusal": ""})["jog_refusal"])

    def _rumble(self) -> None:
        self._rumbles.follow(self._pads.pads)
        is_jogging = self._jogger.jogging is not None
        alert = self._alerts.step(self._driver.driving is not None, self.monotonic_ns(), is_jogging)
        if alert is not None:
            self._rumbles.play(alert)

    def _publish_joy(self) -> None:
        states = self._pads.states
        if states:
            self._joy.publish(self._joy_message(states.get(self._driver.driving or "") or next(iter(states.values()))))

    def _joy_message(self, state: PadState) -> Joy:
        """Return the controls that drive, of the pad that drives or the first one: left, forward, turn; dead-man, turbo."""
        message = Joy()
        message.header.stamp = stamp_from_ns(self.now_ns())
        message.axes = [state.sticks.left, state.sticks.forward, state.sticks.turn_left]
        message.buttons = [int(state.dead_man is DeadMan.HELD), int(state.turbo)]
        return message
