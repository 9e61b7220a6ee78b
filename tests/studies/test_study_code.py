"""What a study has measured counts as long as nothing that it ran is edited."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from fake_detection import CountedFrames, method_settings
from hlp import fingerprints
from hlp.refinement.icp import IcpSettings
from hlp.refinement.pso import PsoSettings
from hlp.stages.store import Output
from hlp.studies import basin, oracle, search
from hlp.studies.basin import BasinSettings
from hlp.studies.oracle import OracleSettings


class NameOnly:
    """A store that makes nothing and returns the output's name."""

    def get_or_make(self, stage: str, fingerprint: str, *_: Any) -> Path:
        return Path(fingerprint)


def names() -> dict[str, str]:
    """Names of what the studies keep; the configured refiner is ICP."""
    method = method_settings("refinement=icp")
    dataset = SimpleNamespace(frames=CountedFrames(), frames_identity="frames", target_ids=())
    settings = SimpleNamespace(seed=0, method=method)
    run: Any = SimpleNamespace(settings=settings, dataset=dataset, config={})
    refiners = {"icp": IcpSettings(), "pso": PsoSettings()}
    task = BasinSettings(compared=("icp", "pso"), refiners=refiners)
    store: Any = NameOnly()
    stages: Any = SimpleNamespace(
        settings=method, dataset=dataset, make=lambda stage: Output(stage, Path())
    )
    space: Any = SimpleNamespace(space=SimpleNamespace(name="s", parameters={}), limit_ms=1.0)
    return {
        "icp": str(basin._stage(run, task, "icp", (), store)),
        "pso": str(basin._stage(run, task, "pso", (), store)),
        "oracle": str(oracle._stage(run, stages, OracleSettings(), (), store)),
        "search": search._study_name(run, space),
    }


@pytest.mark.parametrize(
    ("module", "changed"),
    [
        ("hlp.refinement.icp", {"icp", "pso", "oracle", "search"}),
        ("fake_detection", {"icp", "pso", "oracle", "search"}),  # it reads the frames
        ("hlp.models.pca", set()),
    ],
)
def test_what_was_measured_by_other_code_is_measured_anew(
    module: str, changed: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = names()
    read = fingerprints._read

    def edited(name: str) -> bytes | None:
        content = read(name)
        return content + b"#\n" if content is not None and name == module else content

    monkeypatch.setattr(fingerprints, "_read", edited)
    fingerprints.code_of.cache_clear()
    after = names()
    fingerprints.code_of.cache_clear()
    assert {name for name in before if before[name] != after[name]} == changed
