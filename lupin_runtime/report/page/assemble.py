"""Puts the page together from its template, styles, script and parts."""

from __future__ import annotations

import re
from importlib import resources

from lupin_runtime.report.content import Material, figures
from lupin_runtime.report.findings import clock
from lupin_runtime.report.health import SENSORS
from lupin_runtime.report.page.charts import chart_html, charts
from lupin_runtime.report.page.map_svg import Canvas, fastest_speed, map_svg
from lupin_runtime.report.page.markup import esc, script_json, tag, void
from lupin_runtime.report.page.replay import replay_data
from lupin_runtime.report.page.tables import figure_cards, findings_html, process_table, tag_table
from lupin_runtime.report.page.timeline_html import event_list, timeline_html
from lupin_runtime.report.palette import HEALTH, HEAT_ALPHA, SPECIES, SPEED_RAMP, TIME_RAMP, heat_rgb, species_label
from lupin_runtime.report.raster import HeatMap, heat_maps

_OUTCOMES = {
    "DONE": ("done", "✔", "Mission done"),
    "FAULT": ("fault", "✖", "Mission failed"),
    "LOST": ("fault", "✖", "The stack was lost"),
    "NEVER_UP": ("fault", "✖", "The stack never came up"),
    "REFUSED": ("fault", "✖", "The mission was refused"),
    "INTERRUPTED": ("open", "◼", "Interrupted"),
}
_SLOT = re.compile(r"\{\{(\w+)\}\}")


def page(material: Material) -> str:
    """The whole page as text."""
    canvas = Canvas(material)
    heat = heat_maps(material.tags, material.log.map)
    css, mark, words = _OUTCOMES.get(material.state, ("open", "◼", f"Ended in {material.state}"))
    slots = {
        "title": esc(f"{words} · run {material.run_id}"),
        "css": _asset("page.css") + _colours(),
        "js": _asset("page.js"),
        "data": script_json(replay_data(material, canvas)),
        "outcome_css": css,
        "outcome_mark": mark,
        "state": esc(material.state),
        "headline": esc(_headline(material, words)),
        "facts": _facts(material),
        "cards": figure_cards(material),
        "map": map_svg(material, canvas, heat),
        "heat_choices": _heat_choices(heat),
        "heat_legends": _heat_legends(heat),
        "path_legends": _path_legends(material),
        "layers": _layers(material),
        "legend": _legend(material),
        "timeline": timeline_html(material),
        "events": event_list(material.timeline.events),
        "event_count": str(len(material.timeline.events)),
        "findings": findings_html(material.findings),
        "tags": tag_table(material) if material.tags else tag("p", "No tag was seen.", class_="quiet"),
        "charts": "".join(chart_html(chart, max(material.log.end_s, 1e-3)) for chart in charts(material)),
        "processes": _section("processes", "Processes", process_table(material.facts)),
        "end": f"{material.log.end_s:.1f}",
        "end_clock": clock(material.log.end_s),
        "recording": esc(", ".join(material.recordings)),
        "replay": esc(f"lupin replay {material.run_id}"),
    }
    return _SLOT.sub(lambda match: slots[match[1]], _asset("page.html"))


def _asset(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")


def _colours() -> str:
    """The colours with a meaning as CSS, from the one table that has them."""
    return ":root{" + "".join(f"--health-{name}:{colour};" for name, colour in HEALTH.items()) + "}"


def _headline(material: Material, words: str) -> str:
    n = figures(material)
    took = clock(n["mission_s"] or 0.0)
    if not material.log.mission_id:
        return f"{words} after {took}, without a mission"
    goal = n["score_tags_reachable"] or n["score_tags_total"] or n["tags_seen"]
    return f"{words}: {n['tags_read']} of {goal} tags read in {took}"


def _facts(material: Material) -> str:
    """Where, when and as what the run was started."""
    known = (
        ("Run", material.run_id),
        ("World", material.fact("world")),
        ("Target", material.fact("target")),
        ("Mission", material.log.mission_id),
        ("Started", str(material.metadata.get("started_at", "")).replace("T", " ").replace("+00:00", " UTC")),
    )
    items = (tag("span", tag("b", esc(name)), " ", esc(value)) for name, value in known if value)
    sentence = material.facts.get("sentence")
    said = tag("span", esc(sentence)) if sentence and material.state != "DONE" else ""
    return "".join(items) + said


def _heat_choices(heat: list[HeatMap]) -> str:
    options = (tag("option", esc(SENSORS[h.sensor].label), value=h.sensor) for h in heat)
    return tag("option", "no heat map", value="") + "".join(options)


def _heat_legends(heat: list[HeatMap]) -> str:
    legends = []
    for h in heat:
        ideal = SENSORS[h.sensor]
        stops = ",".join("rgba({},{},{},{:.2f})".format(*heat_rgb(h.sensor, i / 8), HEAT_ALPHA * i / 8) for i in range(9))
        text = f"well: {ideal.low:g} to {ideal.high:g} {ideal.unit} · {h.samples} tag{'s' if h.samples != 1 else ''}"
        parts = (
            tag("b", esc(ideal.label)),
            tag("span", esc(f"{h.low:.4g}")),
            tag("i", class_="ramp", style=f"background:linear-gradient(90deg,{stops})"),
            tag("span", esc(f"{h.high:.4g} {ideal.unit}")),
            tag("small", esc(text)),
        )
        legends.append(tag("div", *parts, class_=f"ramp-row heat-legend heat-{h.sensor}"))
    return "".join(legends)


def _path_legends(material: Material) -> str:
    end, fastest = clock(material.log.end_s), fastest_speed(material)
    rows = (("time", TIME_RAMP, "Path by time", "0:00", end), ("speed", SPEED_RAMP, "Path by speed", "0", f"{fastest:.2f} m/s"))
    return "".join(
        tag(
            "div",
            tag("b", name),
            tag("span", esc(low)),
            tag("i", class_="ramp", style=f"background:linear-gradient(90deg,{','.join(stops)})"),
            tag("span", esc(high)),
            class_=f"ramp-row path-legend by-{key}",
        )
        for key, stops, name, low, high in rows
    )


def _layers(material: Material) -> str:
    """A box for each layer that has something in it."""
    choices = [("path", "Path", True), ("tags", "Tags", True), ("flowers", "Flowers", True), ("boxes", "Boxes", True)]
    if material.log.scans:
        choices.append(("scan", "Lidar", True))
    if material.truth:
        choices.append(("truth", "Truth", False))
    return "".join(
        tag("label", void("input", type="checkbox", data_layer=name, checked=shown), esc(label), class_="choice")
        for name, label, shown in choices
    )


def _legend(material: Material) -> str:
    """What the signs of the map mean."""
    species = {bloom.species for item in material.tags if item.flower for bloom in item.flower.blooms}
    flowers = (
        tag("span", tag("i", class_="dot", style=f"background:{colour}"), esc(species_label(name)))
        for name, colour in SPECIES.items()
        if name in species
    )
    parts = [
        tag("span", tag("i", class_="sign-pin"), "tag, its ring says how the plant is"),
        tag("span", tag("i", "✕", class_="sign-cross"), "not read"),
        *flowers,
        tag("span", tag("i", "✱", class_="sign-bug"), "bug"),
        tag("span", tag("i", "S", class_="sign-end"), "start"),
        tag("span", tag("i", "E", class_="sign-end"), "end"),
        tag("span", tag("i", "◇", class_="sign-correction"), "the map corrected the place"),
    ]
    if material.truth:
        parts.append(tag("span", tag("i", "┄", class_="sign-truth"), "truth"))
    return "".join(parts)


def _section(name: str, title: str, body: str) -> str:
    return tag("section", tag("h2", esc(title)), body, id=name) if body else ""
