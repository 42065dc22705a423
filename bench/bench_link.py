"""A mission across a link that is shaped like WiFi, with an outage and a roam, against the same mission across a perfect link.

The wheels are at rest in every interruption, by the simulator's truth, one second after it began. The mission ends DONE with
every reachable tag read and no collision, in at most 1.3 times the time. Pictures cross as JPEG only. The report has every
interruption.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Annotated, Any

from bench.link_rig import UP_TIMEOUT_S, WIFI, LinkRig, Mission, in_outage, link_rig, running_mission, score
from bench.runner import Figures, World, benchmark, note

MISSION_TIMEOUT_S = 900.0
DRIVE_TIMEOUT_S = 120.0
OUTAGE_S, ROAM_S = 3.0, 5.0
# The robot drives for this long between the interruptions.
BETWEEN_S = 20.0
INTERRUPTIONS = (("switch-dead", OUTAGE_S), ("wifi-roam", ROAM_S))


def _interrupt(rig: LinkRig, mission: Mission) -> None:
    """Interrupt the link twice, each time while the robot drives."""
    for fault, lasts_s in INTERRUPTIONS:
        if not mission.wait_for("robot that drives", rig.is_driving, DRIVE_TIMEOUT_S):
            return
        with rig.without_link(fault):
            time.sleep(lasts_s)
        note(f"{fault} for {lasts_s:g} s")
        time.sleep(BETWEEN_S)


def measure(world: str, faults: bool) -> dict[str, Any]:
    """Run one mission in a world; return its figures."""
    with link_rig(world) as rig:
        if faults:
            rig.shape(WIFI)
        with running_mission(rig) as mission:
            began = mission.wait_for("mission", lambda: mission.state().get("ready_s") is not None, UP_TIMEOUT_S)
            before, began_s = rig.sent_bytes(), time.monotonic()
            subscribers = mission.camera_subscribers() if began else {}
            if began and faults:
                _interrupt(rig, mission)
            result = mission.result(MISSION_TIMEOUT_S)
            sent_bits, lasted_s = 8 * (rig.sent_bytes() - before), time.monotonic() - began_s
            if result.get("report") is None or mission.folder is None:
                raise SystemExit(f"not measured: the run left no report: {result}")
            found = score(rig, mission.folder)
            report = json.loads((mission.folder / "report" / "report.json").read_text())
            track = rig.truth()
    raw = sum(count for topic, count in subscribers.items() if not topic.endswith("/compressed"))
    return {
        "state": result["state"],
        "mission_s": report["figures"]["mission_s"],
        "share_read": found["tags_read"] / found["tags_reachable"],
        "tags_read": found["tags_read"],
        "collisions": found["collisions"],
        "trajectory_rmse_m": found["trajectory_rmse_m"],
        "tag_error_median_m": found["tag_error_median_m"],
        "real_time_factor": found["real_time_factor"],
        "raw_subscribers": raw if subscribers else None,
        "link_mbit_s": sent_bits / lasted_s / 1e6,
        "lost_share": report["link"]["lost_share"],
        "late_s": report["link"]["late_s"],
        "reported_outages": len(report["link"]["outages"]),
        "interruptions": {f"{fault.name} {number}": in_outage(track, fault) for number, fault in enumerate(rig.faults)},
        "reported": report["link"]["outages"],
        "met": result["state"] == "DONE" and len(report["link"]["outages"]) >= len(rig.faults),
    }


@benchmark(
    at_most={"collisions": 0.0, "moved_after_stop_m": 0.01, "raw_subscribers": 0.0, "time_ratio": 1.3},
    at_least={"share_read": 1.0},
    long=True,
)
def main(
    world: World = "walled",
    perfect_s: Annotated[float | None, "the mission's time across a perfect link, if it is known"] = None,
    only_perfect: Annotated[bool, "measure only the mission across a perfect link"] = False,
) -> Figures:
    """Run the mission across a perfect link, and across WiFi with an outage and a roam."""
    figures: dict[str, Any] = {}
    if perfect_s is None:
        figures["perfect"] = measure(world, faults=False)
        perfect_s = figures["perfect"]["mission_s"]
        note("perfect link", figures["perfect"])
    if not only_perfect:
        figures["wifi"] = measure(world, faults=True)
        figures["time_ratio"] = figures["wifi"]["mission_s"] / perfect_s
    return figures


if __name__ == "__main__":
    sys.exit(main())
