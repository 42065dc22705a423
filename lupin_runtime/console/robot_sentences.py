"""What the robot and the console say in sentences that operators read on the page: why it is stopped, locked, or
refuses, and what happens in a mission.

The page shows them in its own language: it finds a sentence by its template, and translates it by the template's name. What is
no sentence of this table is shown as it is.
"""

from __future__ import annotations

from lupin_runtime.console import (
    authority,
    command_era,
    doctor,
    locations,
    maps,
    motion_watch,
    pairing,
    stop_registry,
    voice_listener,
    voice_offline,
    voice_robot,
    voice_session,
)
from lupin_runtime.drive import arbiter
from lupin_runtime.lights import BEFORE_MANUAL
from lupin_runtime.mission import events
from lupin_runtime.safety import console_server_stop, console_stop, estop, estop_monitor, expected_sources
from lupin_runtime.stack import liveness
from lupin_runtime.voice import dialog, envelope, executor, turns
from lupin_runtime.voice.questions import QUESTIONS
from lupin_runtime.voice.tools import TOOLS

# Name → template: `{seconds}` stands for a number, and every other place for text, which may be a sentence itself.
SENTENCES = {
    "button_pressed": estop.BUTTON_PRESSED,
    "button_silent": estop.BUTTON_SILENT,
    "missed_press": estop.MISSED_PRESS,
    "missed_press_or_silence": estop.MISSED_PRESS_OR_SILENCE,
    "unheard_button": expected_sources.UNHEARD[expected_sources.BUTTON],
    "unheard_console": expected_sources.UNHEARD[expected_sources.CONSOLE],
    "unheard_witness": expected_sources.UNHEARD[expected_sources.WITNESS],
    "browser_holds_stop": console_server_stop.BROWSER_HOLDS_STOP,
    "browser_held_stop_unheard": console_server_stop.UNHEARD,
    "console_lost_driving": console_server_stop.LOST,
    "console_holds_stop": console_stop.CONSOLE_HOLDS_STOP,
    "console_lost_holding": console_stop.LOST_HOLDING,
    "consoles_silent": console_stop.LOST,
    "estop_engaged": estop_monitor.ESTOP_ENGAGED,
    "estop_not_received": estop_monitor.ESTOP_NOT_RECEIVED,
    "estop_silent": f"{estop_monitor.ESTOP_SILENT} {{seconds}} s",
    "bus_closed": arbiter.CLOSED,
    "process_silent": f"{{process}} {liveness.SILENT}",
    "process_exited": f"{{process}} {liveness.EXITED}",
    "process_restarting": f"{{process}} {liveness.RESTARTING}",
    "control_held": authority.HELD_BY_OTHER,
    "is_viewer": authority.IS_VIEWER,
    "other_asks": authority.OTHER_ASKS,
    "has_no_control": authority.HAS_NO_CONTROL,
    "nobody_asks": authority.NOBODY_ASKS,
    "not_allowed": authority.NOT_ALLOWED,
    "bad_code": pairing.BAD_CODE,
    "doctor_busy": doctor.BUSY,
    "no_such_finding": doctor.NO_SUCH_FINDING,
    "too_many_locations": locations.TOO_MANY,
    "bad_location_name": locations.BAD_NAME,
    "map_exists": maps.MAP_EXISTS,
    "no_map_saved": maps.NO_MAP_SAVED,
    "not_relocated": maps.NOT_RELOCATED,
    "map_not_loaded": maps.NOT_LOADED,
    "map_not_deleted": maps.NOT_DELETED,
    "map_is_loaded": maps.IS_LOADED,
    "no_such_map": maps.NO_SUCH_MAP,
    "mission_runs": motion_watch.MISSION_RUNS,
    "drives_to_goal": motion_watch.DRIVES_TO_GOAL,
    "listener_busy": voice_listener.BUSY,
    "listener_still_ending": voice_listener.STILL_ENDING,
    "listener_not_ready": voice_listener.NOT_READY,
    "listener_takes_nothing": voice_listener.TAKES_NOTHING,
    "listener_ended": voice_listener.ENDED,
    "listener_ended_with": voice_listener.ENDED_WITH,
    "sentence_outdated": voice_offline.OUTDATED,
    "too_many_sentences": voice_offline.TOO_MANY,
    "event_navigation_retry": events.NAVIGATION_RETRY,
    **{f"event_{code}": label for code, (_, label) in events.LABELS.items() if label != estop_monitor.ESTOP_ENGAGED},
    **{f"detail_{code}": words for code, words in events.EXPLANATIONS.items()},
    **dict(zip(("light_of_stop", "light_of_pause", "light_of_lost_laptop"), BEFORE_MANUAL, strict=True)),
    # What the voice agent reads back, and why its calls are refused.
    **{"_".join(filter(None, ("asks", tool.name, action))): text for tool in TOOLS for action, text in tool.read_back.items()},
    **{
        "_".join(filter(None, ("asks", tool, action, "" if index == 0 else "otherwise"))): text
        for tool, questions in QUESTIONS.items()
        for action, texts in questions.items()
        for index, text in enumerate(texts)
    },
    "call_cut_off": envelope.CUT_OFF,
    "cut_off_flood": turns.FLOOD,
    "cut_off_loop": turns.LOOP,
    "cut_off_insists": turns.INSISTS,
    "cut_off_too_often": turns.TOO_OFTEN,
    "call_estopped": envelope.ESTOPPED,
    "call_page_closed": voice_session.PAGE_CLOSED,
    "call_interrupted": voice_session.INTERRUPTED,
    "call_outdated": command_era.OUTDATED,
    "call_without_turn": envelope.NO_TURN,
    "call_of_old_turn": envelope.OLD_TURN,
    "call_while_speaking": envelope.IS_SPEAKING,
    "call_in_same_turn": envelope.SAME_TURN,
    "call_without_utterance": envelope.NO_UTTERANCE,
    "call_not_confirmed": envelope.NOT_CONFIRMED,
    "call_unknown_confirmation": envelope.UNKNOWN_CONFIRMATION,
    "call_other_arguments": envelope.OTHER_ARGUMENTS,
    "call_late_confirmation": envelope.LATE_CONFIRMATION,
    "call_bursts_too_long": envelope.TOO_LONG,
    "call_without_pose": envelope.NO_POSE,
    "call_driven_by_hand": voice_robot.DRIVEN_BY_HAND,
    "call_without_bus": voice_robot.NO_BUS,
    "call_without_navigation": voice_robot.NO_NAVIGATION,
    "call_robot_refused": executor.ROBOT_REFUSED,
    "call_gripper_refused": executor.GRIPPER_REFUSED,
    "call_without_strip": executor.NO_STRIP,
    **{f"call_unknown_{kind}": executor.UNKNOWN_NAME.format(kind=kind) for kind in ("location", "pose", "sequence")},
    "sentence_canceled": dialog.CANCELED,
    "sentence_answers_nothing": dialog.NOTHING_READ_BACK,
    # Names come last: they may be any text.
    **{f"hold_{kind.value}": text.format("{name}") for kind, text in stop_registry.TEXTS.items()},
    "voice_agent_of": voice_robot.AGENT_OF,
}
