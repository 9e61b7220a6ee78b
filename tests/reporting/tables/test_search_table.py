import csv

from hlp.reporting.tables.repeats import format_search, write_search
from table_text import unpadded


def trial(number, particles, recall, time_ms, error=None):
    values = {"refinement.particles": particles, "refinement.theta_deg": 5.0 + number / 3.0}
    found = {"recall": recall, "time_ms": time_ms, "error": error, "folder": str(number)}
    return {"trial": number, "values": values, **found}


TRIALS = [
    trial(0, 25, 0.8, 90.0),
    trial(1, 50, 0.9, 130.0),
    trial(2, 10, None, None, "no depth"),
    trial(3, 20, 0.8, 70.0),
]
RESULT = {"space": "refinement", "limit_ms": 100.0, "best": TRIALS[3], "trials": TRIALS}


def test_trials_are_ranked_within_the_limit_first():
    table = unpadded(format_search(RESULT, "markdown")).splitlines()
    assert table[0].startswith("4 trials of refinement, 3 of them with a result")
    assert table[4:7] == [
        "| 3 | 0.800 | 70 | 20 | 6 |",
        "| 0 | 0.800 | 90 | 25 | 5 |",
        "| 1 | 0.900 | 130 (over) | 50 | 5.33 |",
    ]
    assert table[-1] == "Best within the limit: refinement.particles=20 refinement.theta_deg=6.0"


def test_no_trial_within_the_limit_is_said():
    assert format_search({**RESULT, "best": None}).endswith("No trial within 100 ms.")


def test_the_csv_holds_every_trial(tmp_path):
    write_search(tmp_path, RESULT)
    with (tmp_path / "search.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["refinement.particles"] for row in rows] == ["25", "50", "10", "20"]
    assert [row["add_recall"] for row in rows] == ["0.8", "0.9", "", "0.8"]
    assert [row["error"] for row in rows] == ["", "", "no depth", ""]
    assert float(rows[1]["refinement.theta_deg"]) == 5.0 + 1 / 3.0
    assert (tmp_path / "search.md").read_text() == format_search(RESULT, "markdown") + "\n"
