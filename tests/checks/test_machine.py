import pytest

from hlp.commands.doctor import check_disk, check_libraries, check_threads, describe_machine


def test_a_missing_library_is_named_with_what_installs_it():
    stated = ["numpy>=2.4,<2.5", "no-such-library>=1.2", "optuna>=5; extra == 'search'"]
    (finding,) = check_libraries(stated)
    assert finding.where == "no-such-library"
    assert finding.advice == "pip install 'no-such-library>=1.2'"
    assert check_libraries() == []


@pytest.mark.parametrize(
    ("environment", "where"),
    [({"OMP_WAIT_POLICY": "active"}, "ACTIVE"), ({"OMP_NUM_THREADS": "64"}, "OMP_NUM_THREADS=64")],
)
def test_threads_that_cost_time_are_named(environment, where):
    (finding,) = check_threads(environment, cores=4)
    assert where in finding.where


def test_usual_threads_have_no_finding():
    assert check_threads({}, cores=4) == []
    good = {"OMP_WAIT_POLICY": "PASSIVE", "OMP_NUM_THREADS": "4", "MKL_NUM_THREADS": "x"}
    assert check_threads(good, cores=4) == []


def test_too_little_disk_is_named(tmp_path):
    folder = tmp_path / "not" / "yet"
    (finding,) = check_disk(folder, free=1e8)
    assert "0.1 GB are free" in finding.problem
    assert check_disk(folder, free=1e12) == []
    assert len(describe_machine()) == 2
