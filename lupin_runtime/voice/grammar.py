"""The voice agent without a model: a sentence becomes one call of a tool, the answer to a read-back, or a question.

What is not understood is asked again, never guessed. A sentence must match a phrase from its first word to its last, so that a
negation, reported speech or a second command makes no call; with a question mark it may be meant, but does nothing. Only words
for stopping act wherever they stand.
"""

from __future__ import annotations

from itertools import pairwise

from lupin_runtime.voice.english import ENGLISH
from lupin_runtime.voice.language import Language
from lupin_runtime.voice.phrases import Sentence
from lupin_runtime.voice.rules import RELEASED_BY_HAND, Unclear, apply
from lupin_runtime.voice.slots import PROBLEM_COST, Slots
from lupin_runtime.voice.tokens import MAX_TOKENS, QUOTES, Token, clean_text, tokenize
from lupin_runtime.voice.tools import BY_NAME, Effect
from lupin_runtime.voice.utterance import NO_CONTEXT, Call, Confirmation, Context, Question

# They act in every language and wherever they stand: a false stop is cheap. From "stopp" on they are spellings that speech
# recognizers write for the first three.
STOP_WORDS = frozenset({"stop", "halt", "nee", "stopp", "nay", "knee", "holt"})
_SIBILANTS = ("s", "se", "ce", "x", "z", "ze")  # "no stop" is often heard as "nose top"
# A sentence about the e-stop that is neither a question for its state nor one for its release engages it.
_ESTOP_WORDS = frozenset({"e-stop", "estop", "noodstop"})
_MAX_NEAREST = 3

# Reasons of questions.
NOTHING = "I heard no command"
TOO_LONG = "that is too long for a command"
NEGATION = "that has a negation; say only what is to be done"
TWO_COMMANDS = "that may be more than one command; say one at a time"
QUOTED = "that is quoted; say the command alone"
ASKED = "that may be a question; say it as a command"
UNKNOWN = "I did not understand that"
AMBIGUOUS = "that can mean more than one thing"
NOTHING_PENDING = "nothing waits for a confirmation"


def parse(text: str, context: Context = NO_CONTEXT, language: Language = ENGLISH) -> Call | Confirmation | Question:
    """Return what a sentence asks for."""
    text = clean_text(text)
    tokens = tokenize(text)
    if _has_stop_word(tokens):
        return Call("engage_estop")
    tokens = _strip(tokens, language)
    if not tokens:
        return Question(NOTHING, language.examples[:_MAX_NEAREST])
    words = tuple(token.text for token in tokens)
    slots = Slots(tokens, text, language, context.names)
    sentence = Sentence(words, language.articles, language.homophones, slots.parse)
    result = _answer(sentence, context, language) or _understand(sentence, context, language)
    if isinstance(result, Question) and result.reason != RELEASED_BY_HAND and _ESTOP_WORDS & set(words):
        return Call("engage_estop")
    doubt = _doubt(result, text)
    if not doubt:
        return result
    meant = result if doubt == ASKED and isinstance(result, Call) and not _writes_offsets(result) else None
    return Question(doubt, _nearest(words, language), meant)


def has_stop_word(text: str) -> bool:
    """Return whether a text has a word for stopping, anywhere."""
    return _has_stop_word(tokenize(clean_text(text)))


def is_doubtful_stop(text: str) -> bool:
    """Return whether the only word for stopping is a "top" behind a sibilant and inside the text.

    "Host off and remove it" is often heard as "those top and remove it". Of "no stop" the end is heard first; "please top" is
    what is written for "please stop", whatever follows.
    """
    words = [token.text for token in tokenize(clean_text(text))]
    tops = _tops(words)
    clear = [at for at in tops if at == len(words) - 1 or words[at - 1] == "please"]
    return STOP_WORDS.isdisjoint(words) and bool(tops) and not clear


def sounds_like_stop(text: str) -> bool:
    """Return whether a text that is spoken may be heard as a word for stopping."""
    return has_stop_word(text) or any(token.text in _ESTOP_WORDS for token in tokenize(clean_text(text)))


def _has_stop_word(tokens: tuple[Token, ...]) -> bool:
    words = [token.text for token in tokens]
    return not STOP_WORDS.isdisjoint(words) or bool(_tops(words))


def _tops(words: list[str]) -> list[int]:
    """Return the indices of each "top" behind a sibilant."""
    return [at for at, (one, two) in enumerate(pairwise(words), 1) if two == "top" and one.endswith(_SIBILANTS)]


def _strip(tokens: tuple[Token, ...], language: Language) -> tuple[Token, ...]:
    """Return the tokens without hesitations, and without fillers at both ends."""
    kept = [token for token in tokens if token.text not in language.hesitations]
    while kept and kept[0].text in language.fillers:
        del kept[0]
    while kept and kept[-1].text in language.fillers:
        del kept[-1]
    return tuple(kept)


def _doubt(result: Call | Confirmation | Question, text: str) -> str:
    """Return why punctuation makes a result doubtful: a question mark, or quotes. A text to speak may have both."""
    if isinstance(result, Question) or (isinstance(result, Confirmation) and not result.agrees):
        return ""
    if isinstance(result, Call) and not may_be_asked(result):
        return ""
    if "?" in text:
        return ASKED
    return QUOTED if QUOTES & set(text) else ""


def may_be_asked(meaning: Call | Confirmation | Question) -> bool:
    """Return whether a question mark makes a call wait for a yes: not what reads or stops, nor a text to speak."""
    if not isinstance(meaning, Call) or meaning.tool == "speak" or meaning.arguments.get("action") == "status":
        return False
    return BY_NAME[meaning.tool].effect not in (Effect.READ, Effect.STOP)


def _answer(sentence: Sentence, context: Context, language: Language) -> Confirmation | Question | None:
    """Return the answer to a read-back; None if the sentence is none, or is a command as nothing was read back."""
    agrees, refuses = _matches(sentence, language.agree), _matches(sentence, language.refuse)
    is_commit = _matches(sentence, language.phrases["calibrate_commit"])
    if context.pending is None:
        is_command = is_commit or _matches(sentence, language.phrases["cancel"])
        return Question(NOTHING_PENDING) if (agrees or refuses) and not is_command else None
    if refuses:
        return Confirmation(False)
    return Confirmation(True) if agrees or (is_commit and _writes_offsets(context.pending)) else None


def _writes_offsets(call: Call) -> bool:
    return call.tool == "calibrate_arm" and call.arguments.get("action") == "commit"


def _matches(sentence: Sentence, patterns: tuple[str, ...]) -> bool:
    return any(True for pattern in patterns for _ in sentence.match(pattern))


def _understand(sentence: Sentence, context: Context, language: Language) -> Call | Question:
    """Return the call that fits with the fewest doubtful words. Of two that fit equally well, only one that stops is made.

    A problem counts like a call: "two hundred percent" must not become "to hundred percent" because only that is in range.
    """
    is_long = len(sentence.words) > MAX_TOKENS
    phrases = {"speak": language.phrases["speak"]} if is_long else language.phrases
    costs: dict[str, int] = {}
    outcomes: dict[str, Call | str] = {}
    for rule, patterns in phrases.items():
        for pattern in patterns:
            for values, cost in sentence.match(pattern):
                outcome: Call | str
                try:
                    outcome = apply(rule, values, context)
                except Unclear as problem:
                    outcome = str(problem)
                key = repr(outcome)
                outcomes[key] = outcome
                costs[key] = min(cost, costs.get(key, cost))
    ranked = sorted(costs, key=lambda key: costs[key])
    nearest = _nearest(sentence.words, language)
    if not ranked:
        return Question(TOO_LONG if is_long else _general_problem(sentence, language), nearest)
    lowest = costs[ranked[0]]
    best = [outcomes[key] for key in ranked if costs[key] == lowest]
    if stop := next((call for call in best if isinstance(call, Call) and BY_NAME[call.tool].effect is Effect.STOP), None):
        return stop
    if lowest >= PROBLEM_COST:
        return Question(_general_problem(sentence, language, str(best[0])), nearest)
    if len(best) > 1:
        return Question(AMBIGUOUS, nearest)
    return best[0] if isinstance(best[0], Call) else Question(best[0], nearest)


def _general_problem(sentence: Sentence, language: Language, otherwise: str = UNKNOWN) -> str:
    """Return the reason that a sentence matches no phrase, as far as single words tell."""
    words = set(sentence.words)
    if words & language.negations:
        return NEGATION
    return TWO_COMMANDS if words & language.conjunctions else otherwise


def _nearest(words: tuple[str, ...], language: Language) -> tuple[str, ...]:
    """Return the examples that share most words with what was heard, if any does."""
    said = set(words[:MAX_TOKENS])
    shared = {example: len(said & set(example.split())) / len(said | set(example.split())) for example in language.examples}
    return tuple(example for example in sorted(shared, key=lambda each: -shared[each])[:_MAX_NEAREST] if shared[example])
