"""The tables and lists of the page: key figures, findings, tags, processes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from lupin_runtime.report.content import Material, figures
from lupin_runtime.report.findings import Finding, clock
from lupin_runtime.report.health import SENSORS, grade
from lupin_runtime.report.log import Picture
from lupin_runtime.report.page.map_svg import OUTCOME_WORDS, anchor
from lupin_runtime.report.page.markup import esc, tag, void
from lupin_runtime.report.palette import SPECIES, SPECIES_OTHER, species_label
from lupin_runtime.report.raster import data_uri, thumbnail
from lupin_runtime.report.tags import READ, TagResult

_PHOTO_PX = 224
# A picture this far from the moment of the reading may show another place.
_PHOTO_WITHIN_S = 4.0
_SEVERITY_WORDS = {"error": ("✖", "Problem"), "warn": ("▲", "Look at this"), "note": ("●", "Note"), "good": ("✔", "Good")}
_OUTCOME_MARKS = {"read": "✔", "unreachable": "✖", "scan_failed": "▲", "skipped": "↷", "seen": "○"}


def figure_cards(material: Material) -> str:
    """The numbers that matter most; what is not known is left out."""
    cards = (
        tag("div", tag("dt", esc(name)), tag("dd", tag("b", esc(value)), tag("span", esc(note))), class_=f"card {css}")
        for name, value, note, css in _cards(material)
    )
    return tag("dl", *cards, class_="cards")


def _cards(material: Material) -> Iterable[tuple[str, str, str, str]]:
    """(name, value, note, css class) of each card."""
    n = figures(material)
    goal = n["score_tags_reachable"] or n["score_tags_total"]
    yield "Tags read", f"{n['tags_read']} of {n['tags_seen']}", "found by the robot", _good(n["tags_read"] == n["tags_seen"])
    if goal and n["score_tags_found"] is not None:
        note = f"reachable; {n['score_tags_total']} in the world"
        yield "Tags found", f"{n['score_tags_found']} of {goal}", note, _good(n["score_tags_found"] >= goal)
    if (error := n["score_tag_error_median_m"]) is not None:
        yield "Tag error", f"{error * 100:.1f} cm", "median, against the truth", _good(error <= 0.05)
    if (error := n["score_trajectory_rmse_m"]) is not None:
        yield "Path error", f"{error * 100:.1f} cm", "RMSE, against the truth", _good(error <= 0.05)
    if n["collisions"] is not None:
        yield "Collisions", f"{n['collisions']:.0f}", "", _good(not n["collisions"])
    if n["distance_m"]:
        yield "Driven", f"{n['distance_m']:.1f} m", "by the wheels", ""
    yield "Mission" if material.log.mission_id else "Recorded", clock(n["mission_s"] or 0.0), "of the robot's time", ""
    if n["flowers"] or n["bugs"]:
        pots = n["score_flowers_total"]
        right = f"; {n['score_flowers_right']} of {pots} pots right" if pots else ""
        yield "Flowers", str(n["flowers"]), f"bugs: {n['bugs']}{right}", ""
    if n["health"] != "no_data":
        yield "Health", str(n["health"]).capitalize(), "worst reading", f"health-{n['health']}"
    if n["known_area_m2"]:
        yield "Mapped", f"{n['known_area_m2']:.0f} m²", "", ""
    if n["real_time_factor"] is not None:
        yield "Real time", f"{n['real_time_factor']:.2f}×", "of the simulation", _good(n["real_time_factor"] >= 1.0 - 5e-3)
    if n["memory_mb"]:
        yield "Memory", f"{n['memory_mb']:.0f} MB", "all processes, peak", ""
    if n["ready_s"] is not None:
        yield "Ready in", f"{n['ready_s']:.1f} s", f"drivable in {n['drivable_s']:.1f} s" if n["drivable_s"] else "", ""


def _good(fine: bool) -> str:
    return "fine" if fine else "off"


def findings_html(found: Sequence[Finding]) -> str:
    """The findings, each with a mark and a word for how grave it is."""
    if not found:
        return tag("p", "Nothing out of the ordinary.", class_="quiet")
    items = []
    for finding in found:
        mark, word = _SEVERITY_WORDS[finding.severity]
        sign = tag("span", mark, class_="mark", role="img", aria_label=word)
        text = tag("div", tag("b", esc(finding.title)), tag("p", esc(finding.detail)) if finding.detail else "")
        items.append(tag("li", sign, text, class_=f"finding {finding.severity}"))
    return tag("ul", *items, class_="findings")


def tag_table(material: Material) -> str:
    """One row a tag; on a narrow screen each row becomes a card with the column's name before each value."""
    scored = any(_error_m(item, material) is not None for item in material.tags)
    names = ["Tag", "At the reading", "Outcome", "Readings", "Flowers", "Place", *(["Error"] if scored else [])]
    head = tag("thead", tag("tr", *(tag("th", esc(name), scope="col") for name in names)))
    rows = (_tag_row(item, material, scored) for item in material.tags)
    return tag("table", head, tag("tbody", *rows), class_="tags")


def _tag_row(item: TagResult, material: Material, scored: bool) -> str:
    cells = [
        tag("th", tag("span", esc(item.tag_id), class_="id"), scope="row"),
        _cell("At the reading", _photos(item, material)),
        _cell("Outcome", _outcome(item)),
        _cell("Readings", _readings(item)),
        _cell("Flowers", _flowers(item)),
        _cell("Place", _place(item)),
    ]
    if scored:
        error = _error_m(item, material)
        cells.append(_cell("Error", esc(f"{error * 100:.1f} cm") if error is not None else "–"))
    return tag("tr", *cells, id=f"tag-{anchor(item.tag_id)}")


def _error_m(item: TagResult, material: Material) -> float | None:
    known = material.tag_truth.get(item.tag_id)
    return known.error_m if known is not None else None


def _cell(name: str, markup: str) -> str:
    return tag("td", markup, data_name=name)


def _photos(item: TagResult, material: Material) -> str:
    log = material.log
    if item.read_s is None or not item.visited:
        return tag("span", "–", class_="quiet")
    images = []
    for pictures, words in ((log.body_pictures, "Front camera"), (log.gripper_pictures, "Gripper camera")):
        picture = nearest(pictures, item.read_s)
        small = thumbnail(picture.jpeg, _PHOTO_PX) if picture is not None else None
        if small is not None:
            images.append(void("img", src=data_uri(small, "jpeg"), alt=f"{words} at tag {item.tag_id}"))
    return tag("div", *images, class_="photos") if images else tag("span", "–", class_="quiet")


def nearest(pictures: Sequence[Picture], t_s: float) -> Picture | None:
    """The picture closest to a moment, if one is close enough; one before it wins over one after."""
    close = [p for p in pictures if abs(p.t_s - t_s) <= _PHOTO_WITHIN_S]
    return min(close, key=lambda p: t_s - p.t_s if p.t_s <= t_s else (p.t_s - t_s) * 2.0, default=None)


def _outcome(item: TagResult) -> str:
    words = OUTCOME_WORDS[item.outcome]
    if item.outcome == READ and not item.visited:
        words = "read from afar"
    parts = [tag("span", f"{_OUTCOME_MARKS[item.outcome]} {esc(words)}", class_=f"badge outcome-{item.outcome}")]
    if item.reason:
        parts.append(tag("small", esc(item.reason)))
    times = []
    if item.discovered_s is not None:
        times.append(f"seen {clock(item.discovered_s)}")
    if item.read_s is not None:
        times.append(f"read {clock(item.read_s)}")
    if item.sightings:
        times.append(f"{item.sightings} sightings")
    parts.append(tag("small", esc(" · ".join(times))))
    return "".join(parts)


def _readings(item: TagResult) -> str:
    if not item.readings:
        return tag("span", "–", class_="quiet")
    rows = []
    for reading in item.readings:
        ideal = SENSORS.get(reading.sensor)
        name, unit = (ideal.label, ideal.unit) if ideal else (reading.sensor, "")
        state = grade(reading.deviation) if ideal else "no_data"
        words = {"healthy": "", "no_data": ""}.get(state, state)
        if ideal and reading.deviation > 0.0:
            side = "low" if reading.value < ideal.low else "high"
            words = f"{words or 'a little'} {side}".strip() if state != "healthy" else f"a little {side}"
        value = tag("b", f"{esc(f'{reading.value:.4g}')} {tag('span', esc(unit), class_='unit')}")
        note = tag("em", esc(words), class_=f"health-{state}") if words else ""
        rows.append(tag("li", tag("span", esc(name)), value, note, class_=f"health-{state}"))
    return tag("ul", *rows, class_="readings")


def _flowers(item: TagResult) -> str:
    look = item.flower
    if look is None:
        return tag("span", "–", class_="quiet")
    counts: dict[str, int] = {}
    for bloom in look.blooms:
        counts[bloom.species] = counts.get(bloom.species, 0) + 1
    if not counts and (look.species or look.flower_count):
        counts = {look.species: look.flower_count or 1}
    chips = [
        tag(
            "span",
            tag("i", style=f"background:{SPECIES.get(s, SPECIES_OTHER)}"),
            esc(f"{n} {species_label(s).lower()}"),
            class_="chip",
        )
        for s, n in counts.items()
    ]
    if look.anomaly:
        chips.append(tag("span", esc(f"✱ {look.bug_count or 1} bug{'s' if look.bug_count > 1 else ''}"), class_="chip bug"))
    chips.append(tag("small", esc(f"{look.confidence:.0%} sure")) if look.species and look.confidence else "")
    return "".join(chips)


def _place(item: TagResult) -> str:
    if item.pose is None:
        return tag("span", "not known", class_="quiet")
    place = tag("span", esc(f"{item.pose.x:.2f}, {item.pose.y:.2f} m"), class_="numbers")
    return place + tag("small", esc(f"height {item.pose.z:.2f} m"))


def process_table(facts: Mapping[str, Any]) -> str:
    """What the processes of the stack took, where the supervisor said so."""
    stages = [stage for stage in facts.get("stages") or () if isinstance(stage, Mapping)]
    if not stages:
        return ""
    names = ("Process", "Up after", "CPU", "Memory", "Restarts", "")
    most = {key: max([float(s.get(key) or 0.0) for s in stages] + [1e-9]) for key in ("up_after_s", "cpu_percent", "memory_mb")}
    rows = []
    for stage in stages:
        bars = (
            _bar(stage, "up_after_s", "s", 1, most, "Up after"),
            _bar(stage, "cpu_percent", "%", 0, most, "CPU"),
            _bar(stage, "memory_mb", "MB", 0, most, "Memory"),
        )
        restarts = int(stage.get("restarts") or 0)
        why = tag("small", esc(stage.get("why") or ""))
        rows.append(
            tag(
                "tr",
                tag("th", esc(stage.get("name", "")), scope="row"),
                *bars,
                _cell("Restarts", esc(restarts) if restarts else "–"),
                _cell("", why),
            )
        )
    head = tag("thead", tag("tr", *(tag("th", esc(name), scope="col") for name in names)))
    return tag("table", head, tag("tbody", *rows), class_="processes")


def _bar(stage: Mapping[str, Any], key: str, unit: str, digits: int, most: Mapping[str, float], name: str) -> str:
    value = stage.get(key)
    if value is None:
        return _cell(name, "–")
    share = 100.0 * float(value) / most[key]
    return _cell(name, tag("span", f"{float(value):.{digits}f} {unit}", class_="bar", style=f"--share:{share:.1f}%"))
