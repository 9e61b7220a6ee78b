"""Which task a configuration asks for, and on which dataset."""

import pytest

from composed_settings import run_settings
from hlp.studies.basin import BasinSettings
from hlp.studies.bench import BenchSettings
from hlp.studies.evaluate import EvaluateSettings
from hlp.studies.oracle import OracleSettings
from hlp.studies.search import SearchSettings


@pytest.mark.parametrize(
    ("choice", "kind"),
    [
        ("experiment=demo", EvaluateSettings),
        ("experiment=oracle", OracleSettings),
        ("experiment=basin", BasinSettings),
        ("task=bench", BenchSettings),
        ("task=search", SearchSettings),
    ],
)
def test_the_configuration_chooses_the_task(choice, kind):
    assert isinstance(run_settings(choice).task, kind)


def test_an_experiment_takes_the_sizes_of_the_world_it_is_run_on():
    """So it finds the stages that a run of that dataset has left."""
    board = ("data=linemod_bop", "data.root=lm")
    for experiment in ("oracle", "basin"):
        demo = run_settings(f"experiment={experiment}")
        assert demo.patches == run_settings().patches
        assert demo.rendering == run_settings().rendering
        own = run_settings(f"experiment={experiment}", *board)
        run = run_settings("experiment=linemod_bop", "data.root=lm")
        assert (own.patches, own.rendering) == (run.patches, run.rendering)
        assert own.rendering != demo.rendering and own.name == experiment


def test_a_refiner_that_is_not_there_is_named_and_others_can_be_added():
    with pytest.raises(ValueError, match=r"^task\.compared names 'psi': choose of pso, icp, none"):
        run_settings("experiment=basin", "task.compared=[psi]")
    with pytest.raises(ValueError, match=r"^task\.refiners\.icp\.points is 'much'"):
        run_settings("experiment=basin", "task.refiners.icp.points=much")
    known = r"^task\.refiners\.icp\.name is 'icq': choose one of icp, none, pso$"
    with pytest.raises(ValueError, match=known):
        run_settings("experiment=basin", "task.refiners.icp.name=icq")
    added = ("task.compared=[paper,wide]", "+refinement@task.refiners.wide=pso")
    task = run_settings("experiment=basin", *added).task
    assert isinstance(task, BasinSettings)
    assert task.refiners["paper"].theta_deg == 5.0 and task.refiners["wide"].theta_deg == 10.0
