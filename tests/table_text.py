"""Comparing tables of text without their padding."""

import re


def unpadded(text: str) -> str:
    """The text with every run of spaces as one."""
    return re.sub(r" +", " ", text)
