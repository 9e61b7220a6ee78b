"""`report.html` of a sweep of studies: all arms with their numbers, and each arm's own page."""

from pathlib import Path

from hlp.errors import DataError
from hlp.files import PAGE, write_text
from hlp.reporting.page.layout import render
from hlp.reporting.page.parts import in_base64
from hlp.reporting.study_arms import read_study_sweeps
from hlp.reporting.study_sweep import differences_table, note_of, study_table


def write_study_sweep_page(folder: Path) -> Path:
    """Write `report.html` of a sweep of studies from what lies in its folder; the file.

    Raises DataError for broken files, and for a sweep that holds no study.
    """
    sweeps = read_study_sweeps(folder)
    if not sweeps:
        raise DataError(f"{folder} holds no finished study (oracle, basin, bench, search)")
    parts = []
    for sweep in sweeps:
        figure = folder / f"{sweep.study}.svg"
        pages = [arm.folder / PAGE for arm in sweep.arms]
        parts.append(
            {
                "study": sweep.study,
                "table": study_table(sweep),
                "best": next((i for i, arm in enumerate(sweep.arms) if arm is sweep.best), None),
                "differences": differences_table(sweep),
                "links": [f"{page.parent.name}/{PAGE}" if page.is_file() else "" for page in pages],
                "note": note_of(sweep),
                "figure": in_base64(figure) if figure.is_file() else "",
            }
        )
    page = render(
        "study_sweep.html",
        title=f"sweep of {', '.join(sweeps[0].keys) or 'nothing'} · {folder.absolute().name}",
        verdict=" ".join(sweep.verdict for sweep in sweeps),
        parts=parts,
        command=sweeps[0].command,
    )
    write_text(folder / PAGE, page)
    return folder / PAGE
