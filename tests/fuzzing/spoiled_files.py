"""Files spoiled at random: bytes, words and JSON values of valid ones exchanged for others."""

import json
import re
from typing import Any

from hypothesis import strategies as st

from generated_values import json_values
from hlp.errors import HlpError

WORDS = (
    *("-1", "0", "1", "2", "1e999", "-1e999", "nan", "1.5", "1e-30", "65536", "4294967296"),
    *("99999999999999999999", "1" + "0" * 400, "null", "true", "[]", "{}", '""', "[[[[]]]]"),
    *("x", "", " ", "\0", "²", "\u2028", "\r", "\n", ",", '"', "'", "\\", "/", "..", "#", "%", "*"),
    *("{", "}", "[", "]", ":", "&a", "*a", "!!python/none", "---", "end_header", "list", "1//1"),
)
NUMBERS_AND_NAMES = re.compile(rb"[\w.+-]+")


@st.composite
def _other_bytes(draw, content):
    """A piece left out, repeated, exchanged or put in."""
    begin = draw(st.integers(0, len(content)))
    end = begin + draw(st.integers(0, 16))
    middle = draw(
        st.just(b"")
        | st.just(content[begin:end] * 2)
        | st.binary(min_size=1, max_size=8)
        | st.sampled_from(WORDS).map(str.encode)
    )
    return content[:begin] + middle + content[end:]


@st.composite
def _other_word(draw, content):
    """A number or name exchanged for another word."""
    places = [item.span() for item in NUMBERS_AND_NAMES.finditer(content)]
    if not places:
        return content
    begin, end = draw(st.sampled_from(places))
    return content[:begin] + draw(st.sampled_from(WORDS)).encode() + content[end:]


def _places(value, path=()):
    inner = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    return [path, *(place for key, item in inner for place in _places(item, (*path, key)))]


@st.composite
def _other_json(draw, content):
    """A value exchanged for any other, or left out."""
    try:
        tree = json.loads(content)
    except ValueError:
        return content
    whole = [tree]
    *way, last = draw(st.sampled_from(_places(whole)[1:]))
    inside: Any = whole
    for key in way:
        inside = inside[key]
    if way and draw(st.booleans()) and draw(st.booleans()):
        del inside[last]
    else:
        inside[last] = draw(json_values() | st.sampled_from([10**400, float("inf"), -1, 1e300]))
    return json.dumps(whole[0]).encode()


@st.composite
def spoiled(draw, valid):
    """The content with one to four changes; sometimes cut off, or something else altogether."""
    if draw(st.integers(0, 30)) == 0:
        return draw(st.binary(max_size=60) | json_values().map(json.dumps).map(str.encode))
    content = valid
    for _ in range(draw(st.integers(1, 4))):
        change = draw(st.sampled_from([_other_bytes, _other_word, _other_json]))
        content = draw(change(content))
    return (
        content[: draw(st.integers(0, len(content)))] if draw(st.integers(0, 9)) == 0 else content
    )


def is_clean(read, path):
    """Whether reading ends with a result; an error must be one of HLP's and name the file."""
    try:
        read()
    except HlpError as error:
        assert path.name in str(error), f"{error!r} does not name {path.name}"
        assert len(str(error)) < 2000, "the message is longer than anybody reads"
        return False
    return True
