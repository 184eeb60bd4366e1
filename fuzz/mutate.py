"""Mutations of saved inputs, by chance of a seed: bytes, numbers, words, lines, parts of others."""

import random
import re
from collections.abc import Sequence

NUMBERS = [b"0", b"-1", b"1e999", b"-1e999", b"nan", b"1e-320", b"2147483648", b"9" * 400, b"1.0"]
NUMBERS += [b"0x10", b"1_0", b"true", b"null", b"''", b"[]", b"{}", b"18446744073709551616", b"1e5"]
WORDS = [b"\n", b"\0", b":", b"- ", b"{", b"[", b'"', b"'", b"&a ", b"*a", b"!!x ", b"\xff", b"\t"]
WORDS += [b"..", b"/", b"\\u0000", b"\xc2\x85", b"\xf0\x9f\x98\x80", b"=", b",", b" GHz", b" dBsm"]
_LARGEST = 2**16


def mutate(rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """One of the seeds with one to six changes."""
    content = rng.choice(seeds)
    for _ in range(rng.choice((1, 1, 2, 3, 6))):
        content = rng.choice(_CHANGES)(rng, content, seeds)[:_LARGEST]
    return content


def _bytes(rng: random.Random, content: bytes, _: Sequence[bytes]) -> bytes:
    changed = bytearray(content or b"\0")
    for _i in range(rng.randint(1, 4)):
        # Heads are where sizes and counts stand.
        place = rng.randrange(min(len(changed), 64) if rng.random() < 0.5 else len(changed))
        changed[place] = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
    return bytes(changed)


def _number(rng: random.Random, content: bytes, _: Sequence[bytes]) -> bytes:
    matches = list(re.finditer(rb"-?\d+(\.\d+)?(e-?\d+)?", content))
    if not matches:
        return content
    match = rng.choice(matches)
    return content[: match.start()] + rng.choice(NUMBERS) + content[match.end() :]


def _word(rng: random.Random, content: bytes, seeds: Sequence[bytes]) -> bytes:
    """Take a word of another seed for one of this."""
    words, other_words = (
        list(re.finditer(rb"[\w-]+", match)) for match in (content, rng.choice(seeds))
    )
    if not words or not other_words:
        return content
    match, replacement = rng.choice(words), rng.choice(other_words)
    return content[: match.start()] + replacement[0] + content[match.end() :]


def _insert(rng: random.Random, content: bytes, _: Sequence[bytes]) -> bytes:
    place = rng.randint(0, len(content))
    return content[:place] + rng.choice(WORDS) + content[place:]


def _cut(rng: random.Random, content: bytes, _: Sequence[bytes]) -> bytes:
    first, last = sorted(rng.randint(0, len(content)) for _i in range(2))
    return content[:first] if rng.random() < 0.3 else content[:first] + content[last:]


def _lines(rng: random.Random, content: bytes, seeds: Sequence[bytes]) -> bytes:
    """Repeat, drop, exchange or bring in a line."""
    lines = content.split(b"\n")
    line, other_line = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(4):
        case 0:
            lines.insert(other_line, lines[line])
        case 1:
            del lines[line]
        case 2:
            lines[line], lines[other_line] = lines[other_line], lines[line]
        case 3:
            lines.insert(line, rng.choice(rng.choice(seeds).split(b"\n")))
    return b"\n".join(lines)


def _splice(rng: random.Random, content: bytes, seeds: Sequence[bytes]) -> bytes:
    other = rng.choice(seeds)
    return content[: rng.randint(0, len(content))] + other[rng.randint(0, len(other)) :]


_CHANGES = (_bytes, _number, _number, _word, _insert, _cut, _lines, _splice)
