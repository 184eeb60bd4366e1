"""Random mutations of inputs: bytes, numbers, words, lines, and parts of other inputs."""

import random
import re
from collections.abc import Sequence

NUMBERS = [b"0", b"-1", b"1e999", b"-1e999", b"nan", b"1e-320", b"2147483648", b"9" * 400, b"1.0"]
NUMBERS += [b"0x10", b"1_0", b"true", b"null", b"''", b"[]", b"{}", b"18446744073709551616", b"1e5"]
WORDS = [b"\n", b"\0", b":", b"- ", b"{", b"[", b'"', b"'", b"&a ", b"*a", b"!!x ", b"\xff", b"\t"]
WORDS += [b"..", b"/", b"\\u0000", b"\xc2\x85", b"\xf0\x9f\x98\x80", b"=", b",", b" GHz", b" dBsm"]
_MAX_BYTES = 2**16


def mutate(rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Return a random seed input with one to six changes."""
    content = rng.choice(seeds)
    for _ in range(rng.choice((1, 1, 2, 3, 6))):
        content = rng.choice(_MUTATIONS)(rng, content, seeds)[:_MAX_BYTES]
    return content


def _change_bytes(rng: random.Random, content: bytes, _: Sequence[bytes]) -> bytes:
    changed = bytearray(content or b"\0")
    for _i in range(rng.randint(1, 4)):
        # Half of the changes hit the first 64 bytes, where headers store sizes and counts.
        index = rng.randrange(min(len(changed), 64) if rng.random() < 0.5 else len(changed))
        changed[index] = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
    return bytes(changed)


def _replace_number(rng: random.Random, content: bytes, _: Sequence[bytes]) -> bytes:
    matches = list(re.finditer(rb"-?\d+(\.\d+)?(e-?\d+)?", content))
    if not matches:
        return content
    match = rng.choice(matches)
    return content[: match.start()] + rng.choice(NUMBERS) + content[match.end() :]


def _replace_word(rng: random.Random, content: bytes, seeds: Sequence[bytes]) -> bytes:
    """Replace a word by a word of another seed input."""
    words, other_words = (
        list(re.finditer(rb"[\w-]+", source)) for source in (content, rng.choice(seeds))
    )
    if not words or not other_words:
        return content
    match, replacement = rng.choice(words), rng.choice(other_words)
    return content[: match.start()] + replacement[0] + content[match.end() :]


def _insert_word(rng: random.Random, content: bytes, _: Sequence[bytes]) -> bytes:
    index = rng.randint(0, len(content))
    return content[:index] + rng.choice(WORDS) + content[index:]


def _cut_part(rng: random.Random, content: bytes, _: Sequence[bytes]) -> bytes:
    first, last = sorted(rng.randint(0, len(content)) for _i in range(2))
    return content[:first] if rng.random() < 0.3 else content[:first] + content[last:]


def _change_lines(rng: random.Random, content: bytes, seeds: Sequence[bytes]) -> bytes:
    """Repeat, delete or swap lines, or insert a line of another seed input."""
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


def _splice_with_seed(rng: random.Random, content: bytes, seeds: Sequence[bytes]) -> bytes:
    other = rng.choice(seeds)
    return content[: rng.randint(0, len(content))] + other[rng.randint(0, len(other)) :]


_MUTATIONS = (
    _change_bytes,
    _replace_number,
    _replace_number,
    _replace_word,
    _insert_word,
    _cut_part,
    _change_lines,
    _splice_with_seed,
)
