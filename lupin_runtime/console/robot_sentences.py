"""What the robot and the console say in sentences that operators read on the page: why it is stopped, locked, or
refuses, and what happens in a mission.

The page shows them in its own language: it finds a sentence by its template, and translates it by the template's name. What is
no sentence of this table is shown as it is.
"""

from __future__ import annotations

from lupin_runtime.console import authority, doctor, locations, maps, motion_watch, pairing, voice_listener, voice_offline
from lupin_runtime.drive import arbiter
from lupin_runtime.mission import events
from lupin_runtime.safety import console_server_stop, console_stop, estop, estop_monitor, expected_sources
from lupin_runtime.stack import liveness

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
}
