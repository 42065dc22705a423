"""The grammar's English."""

from __future__ import annotations

from lupin_runtime.voice.language import Language
from lupin_runtime.voice.spoken_numbers import NumberWords
from lupin_runtime.voice.tools import COLORS

_ONES = (
    "zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve", "thirteen",
    "fourteen", "fifteen", "sixteen", "seventeen", "eighteen", "nineteen",
)  # fmt: skip
_TENS = {"twenty": 20, "thirty": 30, "forty": 40, "fifty": 50, "sixty": 60, "seventy": 70, "eighty": 80, "ninety": 90}

_NUMBERS = NumberWords(
    small={word: value for value, word in enumerate(_ONES)} | _TENS,
    tens=frozenset(_TENS),
    hundred="hundred",
    joiner="and",
    point=frozenset({"point", "dot", "comma"}),
    minus=frozenset({"minus", "negative"}),
    plus=frozenset({"plus", "positive"}),
    fractions={
        ("a",): 1.0, ("an",): 1.0, ("half",): 0.5, ("half", "a"): 0.5, ("a", "half"): 0.5, ("half", "of", "a"): 0.5,
        ("quarter",): 0.25, ("a", "quarter"): 0.25, ("a", "quarter", "of", "a"): 0.25, ("quarter", "of", "a"): 0.25,
        ("three", "quarters"): 0.75, ("three", "quarters", "of", "a"): 0.75, ("a", "hundred"): 100.0,
    },
    and_fractions={
        ("and", "a", "half"): 0.5, ("and", "half"): 0.5, ("and", "a", "quarter"): 0.25, ("and", "three", "quarters"): 0.75,
    },
    homophones={"won": 1, "to": 2, "too": 2, "for": 4, "fore": 4, "ate": 8},
)  # fmt: skip

_GO = "(go|drive|move|navigate|travel|roll) [robot]"
_TURN = "(turn|rotate|spin) [robot]"
_TO_SIDE = "[sideways] [to] {side}"
_TURNED = "[and] (turned [by] {turn_angle:angle} [to] {turn_side:side}|turned [to] {turn_side:side} [by] {turn_angle:angle})"
_TURNING = "[and] (turning|turn|rotating) [to] {turn_side:side} [at|with] {rate}"
_LIGHTS = "(lights|light|leds|led|led strip|light strip|led lights|strip|lamp|lamps)"
_SET = "(set|turn|make|change|switch|put)"
_WHAT = "[what is|what's|how is|how's|show|show me|read|check|tell me|give me|get]"
_LIST = "(list|show|show me|tell me|read|what are|name)"
_MOVE_ARM = "(arm|move arm|put arm|bring arm|set arm|send arm|take arm) [to|in|into|at]"
_SAVE = "(save|store|remember|keep)"
_CANCEL = "(cancel|abort|discard|end|quit)"

_PHRASES = {
    "drive": (
        f"{_GO} ({{way}}|{_TO_SIDE}) [at|with] {{speed}} [for] {{duration}}",
        f"{_GO} ({{way}}|{_TO_SIDE}) [for] {{duration}} [at|with] {{speed}}",
        f"{_GO} [at|with] {{speed}} ({{way}}|{_TO_SIDE}) [for] {{duration}}",
        f"{_GO} [for] {{duration}} ({{way}}|{_TO_SIDE}) [at|with] {{speed}}",
        f"{_GO} {{way}} [at|with] {{speed}} [and] {_TO_SIDE} [at|with] {{side_speed:speed}} [for] {{duration}}",
        f"{_GO} ({{way}}|{_TO_SIDE}) [at|with] {{speed}} {_TURNING} [for] {{duration}}",
        f"{_TURN} [to] {{turn_side:side}} [at|with] {{rate}} [for] {{duration}}",
        f"{_TURN} [to] {{turn_side:side}} [for] {{duration}} [at|with] {{rate}}",
    ),
    "stop": ("(brake|freeze|hold still|stand still|wait|hold on|hold it|whoa)", "(brake|freeze) (wheels|robot)"),
    "nav_goto": (
        "(go|drive|navigate|move) to [coordinates|point|position] x {x:number} [metres|meters] [and] y {y:number} "
        "[metres|meters] [[and|with] (heading|yaw|facing) {yaw:angle}]",
    ),
    "nav_forward": (
        f"[{_GO}] {{way}} [for|by] {{forward:distance}} [{_TURNED}]",
        f"{_GO} [for|by] {{forward:distance}} {{way}} [{_TURNED}]",
        f"{_GO} {_TO_SIDE} [for|by] {{lateral:distance}} [{_TURNED}]",
        f"{_GO} [for|by] {{lateral:distance}} {_TO_SIDE} [{_TURNED}]",
        f"{_GO} [for|by] {{forward:distance}} {{way}} [and] [for|by] {{lateral:distance}} {_TO_SIDE} [{_TURNED}]",
        f"{_GO} {{way}} [for|by] {{forward:distance}} [and] {_TO_SIDE} [for|by] {{lateral:distance}} [{_TURNED}]",
    ),
    "rotate": (
        f"{_TURN} ([to] {{side}}|{{clock}}) [by|for] {{angle}}",
        f"{_TURN} [by|for] {{angle}} ([to] {{side}}|{{clock}})",
        f"{_TURN} [by] {{signed:signed_angle}}",
        "(make|do) {angle} [to] {side}",
    ),
    "turn_around": (f"{_TURN} (around|about|round)",),
    "set_speed_cap": (
        "[set|put|change] speed (cap|limit) [to|at|of] {value:share}",
        "(limit|cap|reduce|set) speed [to|at] {value:share}",
        "[set] (maximum|max|top) speed [to|at|of] {value:share}",
        "{value:share_word} speed",
    ),
    "slower": ("[go|drive|move] slower", "slow down"),
    "faster": ("[go|drive|move] faster", "speed up"),
    "nav_cancel": (f"{_CANCEL} (navigation|navigating|goal|navigation goal|trip|route)",),
    "cancel": (f"{_CANCEL} [it|that]",),
    "nav_goto_named": (
        f"({_GO}|return|come|head) [back] [over] [to|towards] [location|place|waypoint] {{name:location}}",
        "(bring|take|send) (robot|it|yourself) [back] [to] [location|place] {name:location}",
    ),
    "list_named_locations": (
        f"{_LIST} [of|to] [all] [named|known|saved] (locations|places|location|waypoints)",
        "(what|which) (locations|places) (are there|do you know|exist|have you saved)",
        "where can you go",
    ),
    "save_named_location": (
        f"{_SAVE} (here|this|this place|this location|this position|this spot|location|place|position|current position) "
        "(as|named|called) {name:new_location}",
        "(call|name) this (place|location|position|spot) {name:new_location}",
    ),
    "gripper_open": ("open gripper [fully|completely]", "gripper [fully] open"),
    "gripper_close": ("close gripper [fully|completely]", "gripper [fully] closed", "gripper close", "shut gripper"),
    "gripper_set": (
        "[set|move|put|open] gripper [to|at] {percent} [open]",
        "[set|put|open] gripper [to] {percent:half} [open]",
    ),
    "arm_preset": (
        f"{_MOVE_ARM} [preset|pose|position] {{name:preset}} [preset|pose|position]",
        "{name:preset} arm",
    ),
    "arm_goto_pose": (
        f"{_MOVE_ARM} [stored|saved] [pose|position] {{name:pose}} [pose|position]",
        "(go|move) to [arm|arm's] pose {name:pose}",
    ),
    "arm_save_pose": (
        f"{_SAVE} [this|current] [arm|arm's] pose [of arm] (as|named|called) {{name:new_pose}}",
        f"{_SAVE} arm [pose|position] (as|named|called) {{name:new_pose}}",
    ),
    "arm_list_library": (
        f"{_LIST} [of|to] [all] [arm|arm's] [stored|saved] (poses|sequences|library|poses and sequences|sequences and poses)",
        "(what|which) (poses|sequences) (are there|do you know|exist|have you saved)",
    ),
    "arm_run_sequence": (
        "(run|play|replay|start|perform) [arm] [sequence] {name:sequence} [sequence]",
        "(run|play|replay|start|perform) [arm] [sequence] {name:sequence} [sequence] [at|with] {speed:factor} [speed]",
    ),
    "arm_stop": (
        "(freeze|hold) arm",
        f"{_CANCEL} (sequence|replay|arm sequence|arm motion|arm movement|arm)",
    ),
    "record_start": (
        "(start|begin) [a|an] [new] [{mode}] recording [of arm] [{mode}] [(called|named|as) {name:new_sequence} [{mode}]]",
        "record [a|an] [new] [{mode}] [sequence|motion|arm] [{mode}] [(called|named|as) {name:new_sequence} [{mode}]]",
    ),
    "record_save": ("(save|store|finish|end) recording [(as|called|named) {name:new_sequence}]",),
    "record_cancel": ("(cancel|discard|abort|drop) recording",),
    "calibrate_start": ("(start|begin) [a|an] [arm] calibration [of arm]", "calibrate [arm]"),
    "calibrate_commit": (
        "commit [calibration|offsets|zero offsets]",
        "(i have|i've) (moved|posed) arm",
        "arm is (posed|at zero|in its zero pose|in zero pose)",
        "(save|write) (calibration|zero offsets)",
    ),
    "calibrate_cancel": ("(cancel|abort|discard) [arm] calibration",),
    "calibrate_status": (
        f"{_WHAT} [arm] calibration (status|state)",
        "(what is|what's) (status|state) of [arm] calibration",
        "how (is|far is) [arm] calibration",
    ),
    "query_state": (
        f"{_WHAT} (state|status|robot state|robot status|state of robot|status of robot)",
        "how are you",
        "report [state|status]",
    ),
    "query_fields": (
        f"{_WHAT} {{one:field}} [of robot|level|state|status|charge|voltage|percentage]",
        f"{_WHAT} {{one:field}} [and] {{other:field}}",
        "how (full|much|charged) is {one:battery}",
        "how much {one:battery} (is left|do you have|have you|have you got|remains)",
        "where (are you|is [robot]) {one:here}",
        "is {one:estop} (engaged|on|active|pressed)",
        "are you {one:blocked}",
    ),
    # "Halt" alone is often heard as "hold".
    "engage_estop": ("[engage|press|hit|activate|push|trigger] (e-stop|estop|emergency)", "hold"),
    "speak": ("(say|announce|note) {text}",),
    "light_color": (
        f"{_LIGHTS} [to] {{color}}",
        f"{_SET} {_LIGHTS} [to] {{color}}",
        f"{_SET} {{color}} {_LIGHTS}",
        f"{{color}} {_LIGHTS}",
    ),
    "light_auto": (
        f"[{_SET}] {_LIGHTS} [back] [to|on] (auto|automatic|automatically) [mode]",
        f"automatic {_LIGHTS}",
    ),
    "ask_extent": (
        f"{_GO} ({{way}}|{_TO_SIDE})",
        f"{_GO} ({{way}}|{_TO_SIDE}) [at|with] {{speed}}",
        f"{_GO} ({{way}}|{_TO_SIDE}) [for] {{duration}}",
    ),
    "ask_direction": (f"{_GO} [for|by] {{forward:distance}}", f"{_TURN} [by|for] {{angle}}"),
    "ask_angle": (f"{_TURN} ([to] {{side}}|{{clock}})",),
    "release_estop": ("(release|reset|clear|disengage|unlock) (e-stop|estop|emergency)",),
}  # fmt: skip

_USUAL_NAMES = (
    "sink", "door", "kitchen", "corner", "entrance", "exit", "gate", "window", "office", "table", "bench", "shelf", "tap",
    "tank", "charger", "dock", "start", "end", "middle", "row {number}", "bed {number}", "tag {number}", "left row",
    "right row", "tomatoes", "peppers", "cucumbers", "herbs", "look", "look up", "look down", "rest", "reach", "pick", "place",
    "pour", "water", "wave", "dance", "greeting", "test",
)  # fmt: skip

ENGLISH = Language(
    numbers=_NUMBERS,
    units={
        "length": {
            **dict.fromkeys(("metre", "metres", "meter", "meters", "m"), 1.0),
            **dict.fromkeys(("centimetre", "centimetres", "centimeter", "centimeters", "cm"), 0.01),
        },
        "time": {
            **dict.fromkeys(("second", "seconds", "sec", "secs", "s"), 1.0),
            **dict.fromkeys(("millisecond", "milliseconds", "ms"), 0.001),
            **dict.fromkeys(("minute", "minutes", "min"), 60.0),
        },
        "angle": {
            **dict.fromkeys(("degree", "degrees", "deg"), 1.0),
            **dict.fromkeys(("radian", "radians", "rad"), 57.29577951308232),
            **dict.fromkeys(("turn", "turns", "full turn", "full turns"), 360.0),
        },
        "percent": dict.fromkeys(("percent", "per cent"), 1.0),
        "times": dict.fromkeys(("times", "x"), 1.0),
    },
    per_second=("per second", "a second", "per sec", "per s", "each second"),
    choices={
        "side": {"left": 1.0, "right": -1.0},
        "way": {
            **dict.fromkeys(("forward", "forwards", "ahead", "straight ahead", "straight forward"), 1.0),
            **dict.fromkeys(("back", "backward", "backwards", "in reverse"), -1.0),
        },
        "clock": {
            **dict.fromkeys(("counterclockwise", "counter clockwise", "anticlockwise", "anti clockwise"), 1.0),
            "clockwise": -1.0,
        },
        "share_word": {"half": 0.5, "full": 1.0, "maximum": 1.0, "normal": 1.0, "quarter": 0.25},
        "factor_word": {"half": 0.5, "double": 2.0, "twice": 2.0, "normal": 1.0, "full": 1.0, "quarter": 0.25},
        "half": {"half": 50.0, "halfway": 50.0, "half way": 50.0},
        "mode": {
            **dict.fromkeys(("kinesthetic", "kinaesthetic", "kinetic", "by hand", "hand guided"), "kinesthetic"),
            **dict.fromkeys(("teleop", "by teleop", "teleoperated"), "teleop"),
        },
        "field": {
            **dict.fromkeys(("battery", "battery level", "charge"), "battery"),
            **dict.fromkeys(("pose", "position", "location"), "pose"),
            **dict.fromkeys(("e-stop", "estop", "emergency"), "estop"),
        },
        "battery": {"battery": "battery"},
        "estop": dict.fromkeys(("e-stop", "estop", "emergency"), "estop"),
        "here": {"": "pose", "now": "pose"},
        "blocked": {"blocked": "estop"},
        "color": {name: name for name in COLORS},
    },
    phrases=_PHRASES,
    usual_names=_USUAL_NAMES,
    # Not "okay": recognizers write it for noise.
    agree=(
        "yes [do it|go ahead|do that]", "yeah", "yep", "go ahead", "do it", "[i|we] confirm", "confirmed", "affirmative",
        "proceed",
    ),
    refuse=(
        "no", "no (thanks|thank you)", "no (do not|don't)", "(do not|don't) [do (it|that)]", "nope", "cancel [it|that]",
        "never mind", "negative", "abort",
    ),
    articles=frozenset({"the", "my", "your", "its"}),
    fillers=frozenset({"please", "robot", "lupin", "hey", "hi", "now", "thanks", "okay", "ok", "so", "well"}),
    hesitations=frozenset({"uh", "um", "er", "erm", "hmm", "ehm", "uhm"}),
    negations=frozenset({"not", "don't", "dont", "never", "no", "without", "neither", "nor", "can't", "won't", "shouldn't"}),
    conjunctions=frozenset({"and", "then", "after", "before", "while", "but", "or"}),
    homophones={
        "to": ("two", "too", "2"), "for": ("four", "fore", "4"), "by": ("buy", "bye"), "right": ("write", "rite"),
        "forward": ("foreword", "four word", "for word", "foward"), "forwards": ("four words", "for words"),
        "back": ("bach",), "turn": ("tern",), "metre": ("meets her", "meet her", "mitre", "meter's"),
        "metres": ("meets us", "mitres", "meters'"), "seconds": ("second's",), "degrees": ("the grease", "decrease"),
        "gripper": ("grip her", "gripped her", "gripa", "ripper"), "arm": ("harm",), "lights": ("lice", "light's", "likes"),
        "cap": ("cab", "cup", "gap"), "sequence": ("sequins",), "x": ("ex", "eggs"), "y": ("why",), "save": ("safe",),
        "here": ("hear",), "commit": ("come it",), "run": ("ran",),
        "cancel": ("console", "council"), "brake": ("break",), "calibration": ("calibrations",),
        "discard": ("discovered", "this card"),
        "at": ("add",), "half": ("have",),
        "slower": ("slow her", "slowly"), "play": ("plate", "plane"), "list": ("least",),
    },
    examples=(
        "drive forward at 0.2 metres per second for one second", "go two metres forward", "go one metre to the left",
        "turn left ninety degrees", "go to x two y minus one", "go to LOCATION", "list locations", "save here as NAME",
        "what is the battery", "where are you", "lights blue", "lights automatic", "open the gripper", "close the gripper",
        "gripper forty percent", "arm home", "arm pose NAME", "save the arm pose as NAME",
        "run the sequence NAME at half speed", "list sequences", "start recording", "save the recording as NAME",
        "start calibration", "commit the calibration", "calibration status", "speed cap fifty percent", "slower",
        "cancel navigation", "freeze the arm", "stop", "say TEXT",
    ),
)  # fmt: skip
