"""The grammar's Dutch."""

from __future__ import annotations

from lupin_runtime.voice.english import ENGLISH
from lupin_runtime.voice.language import Language
from lupin_runtime.voice.spoken_numbers import NumberWords

_ONES = {"een": 1, "één": 1, "twee": 2, "drie": 3, "vier": 4, "vijf": 5, "zes": 6, "zeven": 7, "acht": 8, "negen": 9}
_TEENS = {
    "nul": 0, "tien": 10, "elf": 11, "twaalf": 12, "dertien": 13, "veertien": 14, "vijftien": 15, "zestien": 16,
    "zeventien": 17, "achttien": 18, "negentien": 19,
}  # fmt: skip
_TENS = {
    "twintig": 20, "dertig": 30, "veertig": 40, "vijftig": 50, "zestig": 60, "zeventig": 70, "tachtig": 80, "negentig": 90,
}  # fmt: skip


def _small_numbers() -> dict[str, int]:
    """Return the numbers from 0 to 999, each of which is one word: "vijfentwintig", "honderdtachtig"."""
    below_hundred = {**_ONES, **_TEENS, **_TENS}
    for one, value in _ONES.items():
        for ten, tens in _TENS.items():
            below_hundred[f"{one}en{ten}"] = below_hundred[f"{one}ën{ten}"] = tens + value
    hundreds = {"honderd": 100, **{f"{one}honderd": 100 * value for one, value in _ONES.items() if value > 1}}
    above = {f"{word}{rest}": value + more for word, value in hundreds.items() for rest, more in below_hundred.items() if more}
    return {**below_hundred, **hundreds, **above}


_GO = "(ga|rij|rijd|beweeg|navigeer) [robot]"
_TURN = "(draai|roteer) [robot]"
_TO_SIDE = "[zijwaarts] [naar] {side}"
_LIGHTS = "(lichten|licht|lampen|lamp|leds|led|ledstrip|strip|verlichting)"
_SET = "(zet|maak|schakel|doe)"
_WHAT = "[wat is|hoe is|toon|lees|geef]"
_LIST = "(noem|toon|geef|lijst|wat zijn)"
_MOVE_ARM = "(arm|beweeg arm|zet arm|breng arm) [naar|in|op]"
_SAVE = "(bewaar|onthoud|sla)"
_AS = "[op] als"
_CANCEL = "(annuleer|breek af|beëindig)"
_TURNED = (
    "[en] (gedraaid [met] {turn_angle:angle} [naar] {turn_side:side}|gedraaid [naar] {turn_side:side} [met] {turn_angle:angle})"
)

_PHRASES = {
    "drive": (
        f"{_GO} ({{way}}|{_TO_SIDE}) [met] {{speed}} [gedurende|voor] {{duration}}",
        f"{_GO} ({{way}}|{_TO_SIDE}) [gedurende|voor] {{duration}} [met] {{speed}}",
        f"{_GO} [met] {{speed}} ({{way}}|{_TO_SIDE}) [gedurende|voor] {{duration}}",
        f"{_GO} [gedurende|voor] {{duration}} [met] {{speed}} ({{way}}|{_TO_SIDE})",
        f"{_TURN} [naar] {{turn_side:side}} [met] {{rate}} [gedurende|voor] {{duration}}",
        f"{_TURN} [gedurende|voor] {{duration}} [met] {{rate}} [naar] {{turn_side:side}}",
    ),
    "stop": ("(rem|sta stil|blijf staan|wacht)",),
    "nav_goto": (
        "(ga|rij|rijd|navigeer) naar [coördinaten|punt] x {x:number} [meter] [en] y {y:number} [meter] "
        "[[en|met] (richting|hoek) {yaw:angle}]",
    ),
    "nav_forward": (
        f"[{_GO}] {{way}} [met] {{forward:distance}} [{_TURNED}]",
        f"[{_GO}] {{forward:distance}} {{way}} [{_TURNED}]",
        f"{_GO} {{lateral:distance}} {_TO_SIDE} [{_TURNED}]",
        f"{_GO} {_TO_SIDE} [met] {{lateral:distance}} [{_TURNED}]",
        f"{_GO} {{forward:distance}} {{way}} [en] {{lateral:distance}} {_TO_SIDE} [{_TURNED}]",
    ),
    "rotate": (
        f"{_TURN} [met] {{angle}} ([naar] {{side}}|{{clock}})",
        f"{_TURN} ([naar] {{side}}|{{clock}}) [met] {{angle}}",
        f"{_TURN} [met] {{signed:signed_angle}}",
    ),
    "turn_around": (f"{_TURN} (om|rond)", "keer om"),
    "set_speed_cap": (
        "[zet] (snelheidslimiet|snelheidsgrens|maximumsnelheid) [op] {value:share}",
        "(beperk|begrens) snelheid [tot|op] {value:share}",
        "zet snelheid op {value:share}",
        "{value:share_word} snelheid",
    ),
    "slower": ("[ga|rij] (langzamer|trager)",),
    "faster": ("[ga|rij] (sneller|vlugger)",),
    "nav_cancel": (f"{_CANCEL} (navigatie|doel|route|rit)",),
    "cancel": (f"{_CANCEL} [het|dat]",),
    "nav_goto_named": (f"({_GO}|keer|kom) [terug] (naar|tot) [locatie|plek|plaats] {{name:location}}",),
    "list_named_locations": (
        f"{_LIST} [alle] [bekende|bewaarde] (locaties|plekken|plaatsen)",
        "welke (locaties|plekken|plaatsen) (zijn er|ken je|ken jij)",
    ),
    "save_named_location": (
        f"{_SAVE} (hier|dit|deze plek|deze plaats|deze locatie|deze positie|plek|locatie) {_AS} {{name:new_location}}",
        "noem deze (plek|plaats|locatie) {name:new_location}",
    ),
    "gripper_open": ("open grijper [helemaal]", "grijper [helemaal] open", "doe grijper open"),
    "gripper_close": ("sluit grijper [helemaal]", "grijper (dicht|toe)", "doe grijper (dicht|toe)"),
    "gripper_set": ("[zet|open] grijper [op|tot] {percent} [open]", "[zet|open] grijper {percent:half} [open]"),
    "arm_preset": (f"{_MOVE_ARM} [stand|houding] {{name:preset}}",),
    "arm_goto_pose": (f"{_MOVE_ARM} [bewaarde] [stand|houding|pose] {{name:pose}}",),
    "arm_save_pose": (
        f"{_SAVE} [deze] (armstand|armhouding|stand van arm|houding van arm|pose) {_AS} {{name:new_pose}}",
        f"{_SAVE} arm {_AS} {{name:new_pose}}",
    ),
    "arm_list_library": (
        f"{_LIST} [alle] (standen|houdingen|poses|sequenties|reeksen|poses en sequenties)",
        "welke (standen|houdingen|poses|sequenties|reeksen) (zijn er|ken je|ken jij)",
    ),
    "arm_run_sequence": (
        "(speel|start|herhaal|voer) [sequentie|reeks] {name:sequence} [af|uit]",
        "(speel|start|herhaal|voer) [sequentie|reeks] {name:sequence} [af|uit] [op|met] {speed:factor} [snelheid] [af|uit]",
    ),
    "arm_stop": ("houd arm stil", f"{_CANCEL} (sequentie|reeks|armbeweging)"),
    "record_start": (
        "(start|begin) [een] [{mode}] opname [van arm] [{mode}] [(genaamd|als|met naam) {name:new_sequence} [{mode}]]",
        "neem [een] [sequentie|reeks|beweging] op [{mode}] [(genaamd|als) {name:new_sequence} [{mode}]]",
    ),
    "record_save": (f"{_SAVE} opname [op] [(als|genaamd) {{name:new_sequence}}]",),
    "record_cancel": ("(annuleer|verwijder|verwerp) opname",),
    "calibrate_start": ("(start|begin) [een] kalibratie [van arm]", "kalibreer [arm]"),
    "calibrate_commit": ("(schrijf|bewaar) (kalibratie|nulpunten)", "ik heb arm (bewogen|gezet)", "arm staat (goed|op nul)"),
    "calibrate_cancel": ("(annuleer|verwerp) kalibratie",),
    "calibrate_status": (f"{_WHAT} (status|stand) van kalibratie", "kalibratie status", "kalibratiestatus"),
    "query_state": (f"{_WHAT} (toestand|status) [van robot]", "hoe gaat het"),
    "query_fields": (
        f"{_WHAT} {{one:field}} [van robot]",
        f"{_WHAT} {{one:field}} [en] {{other:field}}",
        "hoe vol is {one:battery}",
        "waar (ben je|ben jij|is robot) {one:here}",
        "is {one:estop} (ingedrukt|actief)",
        "ben je {one:blocked}",
    ),
    "engage_estop": ("[druk|activeer] noodstop [in]",),
    "speak": ("(zeg|noteer) {text}",),
    "light_color": (f"{_LIGHTS} [op] {{color}}", f"{_SET} {_LIGHTS} [op] {{color}}", f"{{color}} {_LIGHTS}"),
    "light_auto": (f"[{_SET}] {_LIGHTS} [weer] [op] (automatisch|auto)",),
    "ask_extent": (
        f"{_GO} ({{way}}|{_TO_SIDE})",
        f"{_GO} ({{way}}|{_TO_SIDE}) [met] {{speed}}",
        f"{_GO} ({{way}}|{_TO_SIDE}) [gedurende|voor] {{duration}}",
    ),
    "ask_direction": (f"{_GO} {{forward:distance}}", f"{_TURN} [met] {{angle}}"),
    "ask_angle": (f"{_TURN} ([naar] {{side}}|{{clock}})",),
    "release_estop": ("(ontgrendel|reset|herstel) noodstop",),
}  # fmt: skip

_COLORS = {
    "rood": "red", "amber": "amber", "wit": "white", "blauw": "blue", "geel": "yellow", "lentegroen": "spring",
    "cyaan": "cyan", "turquoise": "teal", "paars": "purple", "oranje": "orange", "groen": "green", "uit": "off",
}  # fmt: skip

DUTCH = Language(
    numbers=NumberWords(
        small=_small_numbers(),
        tens=frozenset(),
        hundred="",
        joiner="en",
        point=frozenset({"komma", "punt"}),
        minus=frozenset({"min", "minus"}),
        plus=frozenset({"plus"}),
        fractions={
            ("een", "halve"): 0.5, ("halve",): 0.5, ("half",): 0.5, ("een", "kwart"): 0.25, ("kwart",): 0.25,
            ("anderhalve",): 1.5, ("driekwart",): 0.75,
        },
        and_fractions={("en", "een", "halve"): 0.5, ("en", "een", "half"): 0.5},
        homophones={},
    ),
    units={
        "length": {
            **dict.fromkeys(("meter", "meters", "m"), 1.0),
            **dict.fromkeys(("centimeter", "centimeters", "cm"), 0.01),
        },
        "time": {
            **dict.fromkeys(("seconde", "seconden", "sec", "s"), 1.0),
            **dict.fromkeys(("milliseconde", "milliseconden", "ms"), 0.001),
            **dict.fromkeys(("minuut", "minuten"), 60.0),
        },
        "angle": {
            **dict.fromkeys(("graad", "graden"), 1.0),
            "degrees": 1.0,  # of the sign °
            **dict.fromkeys(("radiaal", "radialen", "rad"), 57.29577951308232),
            **dict.fromkeys(("slag", "slagen"), 360.0),
        },
        "percent": dict.fromkeys(("procent", "percent"), 1.0),
        "times": dict.fromkeys(("keer", "maal", "x"), 1.0),
    },
    per_second=("per seconde", "per s"),
    choices={
        **ENGLISH.choices,
        "side": {"links": 1.0, "rechts": -1.0},
        "way": {**dict.fromkeys(("vooruit", "naar voren", "rechtdoor"), 1.0), **dict.fromkeys(("achteruit", "terug"), -1.0)},
        "clock": {"linksom": 1.0, "rechtsom": -1.0},
        "share_word": {"halve": 0.5, "volle": 1.0, "maximale": 1.0, "normale": 1.0},
        "factor_word": {"halve": 0.5, "dubbele": 2.0, "normale": 1.0, "volle": 1.0},
        "half": dict.fromkeys(("half", "halfopen"), 50.0),
        "mode": {
            **dict.fromkeys(("kinesthetisch", "kinesthetische", "met de hand", "handmatig"), "kinesthetic"),
            **dict.fromkeys(("teleop", "op afstand"), "teleop"),
        },
        "field": {
            **dict.fromkeys(("batterij", "accu", "lading"), "battery"),
            **dict.fromkeys(("positie", "plaats", "locatie"), "pose"),
            "noodstop": "estop",
        },
        "battery": dict.fromkeys(("batterij", "accu"), "battery"),
        "estop": {"noodstop": "estop"},
        "here": {"": "pose", "nu": "pose"},
        "blocked": {"geblokkeerd": "estop"},
        "color": _COLORS,
    },
    phrases=_PHRASES,
    agree=("ja", "ja (doe maar|graag)", "doe maar", "ga door", "[ik] bevestig", "akkoord", "klopt"),
    refuse=("niet doen", "doe (het|dat) niet", "annuleer [het|dat]", "laat maar"),
    articles=frozenset({"de", "het", "je", "jouw", "mijn"}),
    fillers=frozenset({"alsjeblieft", "alstublieft", "graag", "robot", "lupin", "hé", "hee", "hoi", "nu", "dus", "oké", "ok"}),
    hesitations=frozenset({"eh", "ehm", "uh", "uhm", "hm"}),
    negations=frozenset({"niet", "geen", "nooit", "zonder", "noch"}),
    conjunctions=frozenset({"en", "dan", "daarna", "voordat", "terwijl", "maar", "of"}),
    homophones={},
    examples=(
        "rij vooruit met 0,2 meter per seconde voor een seconde", "ga twee meter vooruit", "ga een meter naar links",
        "draai negentig graden naar links", "ga naar x twee y min een", "ga naar LOCATION", "noem de locaties",
        "bewaar hier als NAME", "wat is de batterij", "waar ben je", "lichten blauw", "lichten automatisch", "open de grijper",
        "sluit de grijper", "grijper veertig procent", "arm naar home", "arm naar stand NAME", "bewaar de armstand als NAME",
        "start de sequentie NAME op halve snelheid", "noem de sequenties", "start opname", "bewaar de opname als NAME",
        "start kalibratie", "schrijf de kalibratie", "kalibratie status", "snelheidslimiet vijftig procent", "langzamer",
        "annuleer de navigatie", "houd de arm stil", "stop", "zeg TEXT",
    ),
)  # fmt: skip
