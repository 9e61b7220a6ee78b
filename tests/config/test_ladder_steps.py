"""The steps of experiment=ladder, from the paper to our best: each differs from one before it."""

from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from composed_settings import run_settings

pytestmark = pytest.mark.slow  # forty steps are composed
CONF = Path(__file__).parents[2] / "conf"
STEPS = sorted(yaml.safe_load((CONF / "ladder.yaml").read_text()))
BOARD = ("data=bop", "data.root=folder", "hydra.mode=RUN")


@pytest.fixture(scope="module")
def steps():
    return {name: run_settings(*BOARD, "experiment=ladder", f"ladder={name}") for name in STEPS}


def test_the_sweep_runs_every_step_once_after_the_one_it_is_compared_with(steps):
    experiment = yaml.safe_load((CONF / "experiment" / "ladder.yaml").read_text())
    swept = [part.strip() for part in experiment["hydra"]["sweeper"]["params"]["ladder"].split(",")]
    assert sorted(swept) == STEPS
    for number, name in enumerate(swept):
        before = steps[name].step.before
        assert before is None if number == 0 else before in swept[:number], name


def test_it_goes_from_the_paper_to_the_letter_over_what_was_meant_to_our_best(steps):
    for name, method in (("literal", "paper_literal"), ("entries", "paper"), ("best", "hlp")):
        expected = run_settings(*BOARD, f"method={method}").method
        assert steps[name].method == expected, name


def test_every_step_changes_the_method_and_says_what(steps):
    for name, settings in steps.items():
        if settings.step.before is not None:
            assert settings.method != steps[settings.step.before].method, name
        assert settings.step.change, name
    assert len({settings.step.change for settings in steps.values()}) == len(steps)


def test_the_last_step_is_only_about_speed(steps):
    last, best = steps["templates"].method, steps["best"].method
    patches = replace(last.patches, name="hlp", grid=best.patches.grid)
    assert replace(last, patches=patches, codebook=best.codebook) == best
