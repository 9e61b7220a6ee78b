"""The searches that objects share, written into a folder of learnt objects."""

import shutil
from pathlib import Path

from hlp.checksums import folder_checksums
from hlp.codebook.neighbours import is_joint
from hlp.method.find.patch_matching import load_together, search_groups
from hlp.method.learn.learnt_folder import SEARCHES, LearntFolder, LearntRecord, searches_part
from hlp.method.stage_settings import CoarseStage


def write_searches(folder: Path, record: LearntRecord) -> dict[str, str]:
    """Prepare the search in several codebooks at once, if the settings of a folder ask for it.

    Returns the checksums of the files by their paths in the folder.
    """
    settings = record.settings
    if not is_joint(settings.codebook):
        return {}
    learnt = LearntFolder(folder, record=record)
    files: dict[str, str] = {}
    for members in search_groups(learnt.models, learnt.models, CoarseStage.of(settings)):
        _, features = load_together(learnt, members)
        part = searches_part(members)
        (folder / part).mkdir(parents=True, exist_ok=True)
        settings.codebook.prepare(features, settings.seed, folder / part)
        written = folder_checksums(folder / part)
        files |= {f"{part}/{name}": checksum for name, checksum in written.items()}
    return files


def remove_stale_searches(folder: Path, record: LearntRecord) -> None:
    """Remove searches that no file of the record belongs to."""
    if (folder / SEARCHES).is_dir():
        for part in (folder / SEARCHES).iterdir():
            if not any(name.startswith(f"{SEARCHES}/{part.name}/") for name in record.files):
                shutil.rmtree(part)
