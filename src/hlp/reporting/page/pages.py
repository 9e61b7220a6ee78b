"""The pages of everything in or below a folder."""

from pathlib import Path

from hlp.files import MANIFEST, SCORES, SWEEP
from hlp.reporting.page.run_page import write_run_page
from hlp.reporting.page.study_page import study_folders, write_study_page, write_study_sweep_page
from hlp.reporting.page.sweep_page import write_sweep_page
from hlp.reporting.results import read_results, result_folders
from hlp.reporting.study_arms import read_study_sweeps


def write_pages(folder: Path) -> list[Path]:
    """Write the page of the run, sweep or study in a folder; of all in it if there are several.

    The runs of a sweep have pages of their own too. Raises what the pages raise.
    """
    written = []
    for found in result_folders(folder):
        if (found / SWEEP).is_file():
            arms = sorted(path.parent for path in found.glob(f"*/{SCORES}"))
            written += [write_run_page(arm) for arm in arms if (arm / MANIFEST).is_file()]
            if read_study_sweeps(found):
                written.append(write_study_sweep_page(found))
            elif read_results(found).results:
                written.append(write_sweep_page(found))
        elif (found / SCORES).is_file():
            written.append(write_run_page(found))
    return written + [write_study_page(found) for found in study_folders(folder)]
