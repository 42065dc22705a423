"""Speech to text by Moonshine tiny.en, on the processor: what was said, and which sentence of a graph it most likely was.

The model takes sound of any length, and does not pad it. Its two parts are run by ONNX Runtime here, not by the library of its
makers, which gives a text and no probabilities. Sound is that of `endpointer.py`. Model and license (MIT):
https://github.com/moonshine-ai/moonshine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from lupin_runtime.voice.endpointer import SAMPLE_RATE_HZ
from lupin_runtime.voice.sentence_graph import SentenceGraph

ENCODER, DECODER, VOCABULARY = "encoder_model.ort", "decoder_model_merged.ort", "tokenizer.bin"

_BEGIN, _END = 1, 2  # tokens
_BYTES = 3  # the first of 256 tokens for single bytes
_LETTERS = 259  # the first token of letters
_SPACE = "▁"
_TOKENS_PER_S = 6.5  # as its makers have it: without a limit it may repeat one word for ever
_MIN_TOKENS, _MAX_SENTENCE_TOKENS = 6, 60
_HEADS, _HEAD_SIZE = 8, 36
_BEAMS = 12
_SCORED = 4  # texts at once: each takes 128 kB for every token
_MIN_SAMPLES = SAMPLE_RATE_HZ // 4

Floats = NDArray[np.float32]
Decode = Callable[[Floats, NDArray[np.int64], dict[str, Floats]], tuple[Floats, dict[str, Any]]]


class Heard(NamedTuple):
    """A text, and the logarithm of its probability."""

    text: str
    log_probability: float


@dataclass(frozen=True)
class _Beam:
    tokens: tuple[int, ...]
    score: float
    states: frozenset[int]


class Moonshine:
    """The model in a folder. `threads` is for each of its two parts."""

    def __init__(self, folder: Path, *, threads: int = 2) -> None:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # it would burn a core between two sentences
        load = onnxruntime.InferenceSession
        self._encoder = load(str(folder / ENCODER), options, providers=["CPUExecutionProvider"])
        self._decoder = load(str(folder / DECODER), options, providers=["CPUExecutionProvider"])
        self._vocabulary = read_vocabulary((folder / VOCABULARY).read_bytes())
        self._merged = {text: token for token, text in reversed(list(enumerate(self._vocabulary))) if token >= _LETTERS}
        self._outputs = [output.name for output in self._decoder.get_outputs()]
        self._past = [put.name for put in self._decoder.get_inputs() if put.name.startswith("past_key_values.")]

    def encode_text(self, text: str) -> list[int]:
        """Return the tokens of a text, which has a space where one is to be."""
        parts = [letter.encode(errors="replace") for letter in text.replace(" ", _SPACE)]
        while pairs := [
            (token, place)
            for place, pair in enumerate(pairwise(parts))
            if (token := self._merged.get(b"".join(pair))) is not None
        ]:
            _, place = min(pairs)  # what comes first in the vocabulary is merged first
            parts[place : place + 2] = [parts[place] + parts[place + 1]]
        tokens: list[int] = []
        for part in parts:
            tokens.extend([self._merged[part]] if part in self._merged else (_BYTES + byte for byte in part))
        return tokens

    def encode_sound(self, sound: bytes, slowness: float = 1.0) -> Floats:
        """Return what the model makes of a sound, played slower by a factor: (1, frames, 288)."""
        samples = np.frombuffer(sound, "<i2").astype(np.float32) / 32768.0
        if slowness != 1.0:
            places = np.linspace(0.0, len(samples) - 1.0, int(len(samples) * slowness))
            samples = np.interp(places, np.arange(len(samples)), samples).astype(np.float32)
        samples = np.pad(samples, (0, max(0, _MIN_SAMPLES - len(samples))))[None]
        given = {"input_values": samples, "attention_mask": np.ones(samples.shape, np.int64)}
        encoded: Floats = self._encoder.run(None, given)[0]
        return encoded

    def write(self, encoded: Floats, seconds: float) -> Heard:
        """Return the text that a sound of so many seconds most likely is, token by token."""
        tokens: list[int] = []
        score = 0.0
        state = _Decoding(self._decode, self._past, encoded)
        for _ in range(_MIN_TOKENS + int(seconds * _TOKENS_PER_S)):
            logarithms = state.step([tokens[-1] if tokens else _BEGIN])[0]
            token = int(logarithms.argmax())
            score += float(logarithms[token])
            if token == _END:
                break
            tokens.append(token)
        return Heard(self.decode_tokens(tokens), score)

    def search(self, encoded: Floats, graph: SentenceGraph, floor: float, count: int) -> list[Heard]:
        """Return the likeliest sentences of a graph whose logarithm is above a floor: at most `count`, the best first."""
        beams = [_Beam((), 0.0, graph.start)]
        found: list[tuple[float, tuple[int, ...]]] = []
        state = _Decoding(self._decode, self._past, encoded)
        for _ in range(_MAX_SENTENCE_TOKENS):
            logarithms = state.step([beam.tokens[-1] if beam.tokens else _BEGIN for beam in beams])
            scores = [beam.score for beam in beams]
            found.extend(
                (score + float(logarithms[row, _END]), beam.tokens)
                for row, (score, beam) in enumerate(zip(scores, beams))
                if graph.may_end(beam.states)
            )
            found = sorted((each for each in found if each[0] > floor), reverse=True)[:count]
            if len(found) == count:
                floor = found[-1][0]
            next_steps = sorted(
                (
                    (beam.score + float(logarithms[row, token]), row, token)
                    for row, beam in enumerate(beams)
                    for token in graph.allowed(beam.states)
                ),
                reverse=True,
            )[:_BEAMS]
            next_steps = [step for step in next_steps if step[0] > floor]
            if not next_steps:
                break
            state.keep([row for _, row, _ in next_steps])
            beams = [
                _Beam((*beams[row].tokens, token), score, graph.follow(beams[row].states, token))
                for score, row, token in next_steps
            ]
        return [Heard(self.decode_tokens(tokens), score) for score, tokens in found]

    def score(self, encoded: Floats, texts: Sequence[str]) -> list[tuple[float, int]]:
        """Return for each text the logarithm of its probability as what a sound is, and of how many tokens it is."""
        return [
            score for first in range(0, len(texts), _SCORED) for score in self._score(encoded, texts[first : first + _SCORED])
        ]

    def _score(self, encoded: Floats, texts: Sequence[str]) -> Iterator[tuple[float, int]]:
        tokens = [self.encode_text(f" {text}") for text in texts]
        rows, length = len(tokens), 1 + max(map(len, tokens))
        given = np.full((rows, length), _END, np.int64)
        given[:, 0] = _BEGIN
        for row, each in enumerate(tokens):
            given[row, 1 : 1 + len(each)] = each
        logarithms = self._decode(np.repeat(encoded, rows, 0), given, {})[0]
        for row, each in enumerate(tokens):
            yield float(logarithms[row, range(len(each) + 1), [*each, _END]].sum()), len(each)

    def decode_tokens(self, tokens: Iterable[int]) -> str:
        """Return the text of tokens."""
        return b"".join(self._vocabulary[token] for token in tokens).decode(errors="replace").replace(_SPACE, " ").strip()

    def _decode(self, encoded: Floats, tokens: NDArray[np.int64], past: dict[str, Floats]) -> tuple[Floats, dict[str, Any]]:
        """Return the logarithms of the probabilities of what follows each token, (texts, tokens, all), and the outputs."""
        rows = len(tokens)
        empty = np.zeros((rows, _HEADS, 0, _HEAD_SIZE), np.float32)
        given = {
            **{name: past.get(name, empty) for name in self._past},
            "input_ids": tokens,
            "encoder_hidden_states": encoded,
            "encoder_attention_mask": np.ones(encoded.shape[:2], np.int64),
            "use_cache_branch": np.array([bool(past)]),
        }
        outputs = dict(zip(self._outputs, self._decoder.run(None, given)))
        logits = outputs["logits"]
        shifted = logits - logits.max(-1, keepdims=True)
        return shifted - np.log(np.exp(shifted).sum(-1, keepdims=True)), outputs


class _Decoding:
    """What the decoder has made of the tokens so far, of several texts that are as long as each other."""

    def __init__(self, decode: Decode, names: list[str], encoded: Floats) -> None:
        self._decode = decode
        self._names = names
        self._encoded = encoded
        self._of_sound: dict[str, Floats] = {}
        self._of_texts: dict[str, Floats] = {}

    def step(self, tokens: list[int]) -> Floats:
        """Take the next token of each text; return the logarithms of the probabilities of what follows, (texts, tokens)."""
        rows = len(tokens)
        past = {name: np.repeat(values, rows, 0) for name, values in self._of_sound.items()} | self._of_texts
        logarithms, outputs = self._decode(np.repeat(self._encoded, rows, 0), np.array(tokens, np.int64)[:, None], past)
        for name in self._names:
            present = outputs[name.replace("past_key_values", "present", 1)]
            if ".decoder." in name:
                self._of_texts[name] = present
            elif name not in self._of_sound:
                self._of_sound[name] = present[:1]
        following: Floats = logarithms[:, -1]
        return following

    def keep(self, rows: list[int]) -> None:
        """Go on with these texts, of which one may occur more than once."""
        self._of_texts = {name: values[rows] for name, values in self._of_texts.items()}


def read_vocabulary(contents: bytes) -> list[bytes]:
    """Return the texts of the tokens: each is preceded by its length, in one byte, or in two if it has 128 bytes or more."""
    texts: list[bytes] = []
    place = 0
    while place < len(contents):
        length = contents[place]
        place += 1
        if length >= 128:
            length += contents[place] * 128 - 128
            place += 1
        texts.append(contents[place : place + length])
        place += length
    return texts
