"""Files spoiled at random: bytes, words and JSON values of valid ones exchanged for others."""

import json
import re
from random import Random
from typing import Any

from hlp.errors import HlpError

WORDS = (
    *("-1", "0", "1", "2", "1e999", "-1e999", "nan", "1.5", "1e-30", "65536", "4294967296"),
    *("99999999999999999999", "1" + "0" * 400, "null", "true", "[]", "{}", '""', "[[[[]]]]"),
    *("x", "", " ", "\0", "²", "\u2028", "\r", "\n", ",", '"', "'", "\\", "/", "..", "#", "%", "*"),
    *("{", "}", "[", "]", ":", "&a", "*a", "!!python/none", "---", "end_header", "list", "1//1"),
)
VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, 1, -1, 7, 2**31, 2**64, 10**400, 0.5, -0.5, 1e-300, 1e300),
    *(float("inf"), float("nan"), "", "x", "../x", "/etc/passwd", "\0", "é" * 300, "1" * 5000),
    *([], {}, [0], [[]], [None], ["x"], {"x": 1}, {"": []}, [1.0] * 3, [1.0] * 9, [[1, 2], [3]]),
)
NUMBERS_AND_NAMES = re.compile(rb"[\w.+-]+")


def _other_bytes(content: bytes, rng: Random) -> bytes:
    """A piece left out, repeated, exchanged or put in."""
    begin = rng.randint(0, len(content))
    end = begin + rng.randint(0, 16)
    piece = rng.choice(
        (b"", content[begin:end] * 2, rng.randbytes(rng.randint(1, 8)), _word(rng), b"\xff" * 4)
    )
    return content[:begin] + piece + content[end:]


def _other_bit(content: bytes, rng: Random) -> bytes:
    """One bit changed, in the header half of the time."""
    at = rng.randrange(min(len(content), rng.choice((64, len(content))))) if content else 0
    return (
        content[:at]
        + bytes(byte ^ 1 << rng.randrange(8) for byte in content[at : at + 1])
        + (content[at + 1 :])
    )


def _other_word(content: bytes, rng: Random) -> bytes:
    """A number or name exchanged for another word."""
    places = [item.span() for item in NUMBERS_AND_NAMES.finditer(content[:100_000])]
    if not places:
        return content
    begin, end = rng.choice(places)
    return content[:begin] + _word(rng) + content[end:]


def _word(rng: Random) -> bytes:
    return rng.choice(WORDS).encode()


def _other_json(content: bytes, rng: Random) -> bytes:
    """A value exchanged for any other, or left out."""
    try:
        whole = [json.loads(content)]
    except (ValueError, RecursionError):
        return content
    *way, last = rng.choice(_places(whole)[1:])
    inside: Any = whole
    for key in way:
        inside = inside[key]
    if way and rng.random() < 0.25:
        del inside[last]
    else:
        inside[last] = rng.choice(VALUES)
    return json.dumps(whole[0]).encode()


def _places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    listed = enumerate(value) if isinstance(value, list) else ()
    inner = value.items() if isinstance(value, dict) else listed
    return [path, *(place for key, item in inner for place in _places(item, (*path, key)))]


def spoiled(content: bytes, rng: Random) -> bytes:
    """The content with one to four changes; sometimes cut off, or something else altogether."""
    if rng.random() < 0.03:
        return rng.choice((rng.randbytes(60), b"", json.dumps(rng.choice(VALUES)).encode()))
    for _ in range(rng.randint(1, 4)):
        content = rng.choice((_other_bytes, _other_bit, _other_word, _other_json))(content, rng)
    return content[: rng.randint(0, len(content))] if rng.random() < 0.1 else content


def is_clean(read, named) -> bool:
    """Whether reading ends with a result; an error must be one of HLP's and name the file."""
    try:
        read()
    except HlpError as error:
        assert named in str(error), f"{error!r} does not name {named}"
        assert len(str(error)) < 2000, "the message is longer than anybody reads"
        return False
    return True
