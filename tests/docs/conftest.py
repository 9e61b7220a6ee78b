"""The documentation's own modules, which are no package: loaded from docs/hooks."""

import importlib.util
import sys
from types import ModuleType

import pytest
from markdown_pages import ROOT


@pytest.fixture(scope="session")
def settings_reference() -> ModuleType:
    path = ROOT / "docs" / "hooks" / "settings_reference.py"
    spec = importlib.util.spec_from_file_location("settings_reference", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["settings_reference"] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module
