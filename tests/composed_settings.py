"""Settings as `hlp run` composes them."""

from functools import cache

from hlp.commands.composing import compose_config
from hlp.config.build import build_settings
from hlp.config.settings import RunSettings


@cache
def run_settings(*overrides: str) -> RunSettings:
    """Those with these overrides; each once, since composing takes half a second."""
    return build_settings(compose_config("output=out", *overrides))
