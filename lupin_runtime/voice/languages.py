"""The languages of the grammar."""

from __future__ import annotations

from lupin_runtime.voice.dutch import DUTCH
from lupin_runtime.voice.english import ENGLISH
from lupin_runtime.voice.language import Language

LANGUAGES: dict[str, Language] = {"en": ENGLISH, "nl": DUTCH}
