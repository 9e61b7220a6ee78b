from hlp.reporting.run_names import short_name


def test_names_begin_with_what_differs() -> None:
    values = {"refinement": "icp", "refinement.particles": "25", "seed": "1"}
    assert short_name(values, {"refinement", "data"}, "demo") == "icp, particles 25, seed 1"
    assert short_name({}, (), "demo") == "demo"


def test_what_changes_no_pose_is_not_named() -> None:
    values = {"data": "bop", "data.root": "/a/b", "panels": "0", "machine.threads": "1"}
    assert short_name(values, {"data"}, "demo") == "bop"


def test_long_names_are_cut() -> None:
    assert len(short_name({f"a.key{i}": "value" for i in range(20)}, (), "demo")) <= 48
