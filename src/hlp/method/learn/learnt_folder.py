"""A folder of learnt objects: everything that detection needs, to be copied to any machine.

<folder>/learnt.json            format, objects, the classifier's classes, settings, checksums of
                                all files
<folder>/classifier/, encoder/  the networks
<folder>/objects/NAME/          object.json, model.npz (meshes, symmetries, near_symmetries),
                                colors.npz if the mesh has colours, texture.png if it has a texture,
                                codebook.npz, lists.npz of its search
<folder>/searches/NAME/         lists.npz of the search in several codebooks at once (joint_lists)

Nothing in it is pickled, so reading it runs no code of whoever wrote it, and no file outside of it
is read. Checksums find damage, not intent: the libraries that read networks and search indices are
not made for hostile files, so load folders from people you trust.
"""

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path

from hlp import fingerprints
from hlp.codebook.entries import load_codebook
from hlp.codebook.neighbours import is_joint
from hlp.errors import ConfigError, DamagedError, DataError, MissingFileError
from hlp.files import read_json, write_json
from hlp.folders import own_files
from hlp.method.find.patch_matching import load_codebooks, search_groups
from hlp.method.learn.model_files import load_classifier, read_model
from hlp.method.settings import CoarseStage, Device, MethodSettings
from hlp.models.encoder import Encoder
from hlp.models.network import Network
from hlp.records import Codebook, ObjectModel
from hlp.settings import Stored, WholeNumber, stored_as

FORMAT = 10
RECORD = "learnt.json"
CLASSIFIER, ENCODER, OBJECTS, SEARCHES = "classifier", "encoder", "objects", "searches"
NAME = re.compile(r"[\w][\w .+-]{0,79}")
"""What an object may be called: the name is that of its folder. At most 80 characters."""
_AGAIN = "learn the objects again, or copy the folder anew"


@dataclass(frozen=True)
class LearntRecord(Stored):
    """The content of `learnt.json`.

    `classes` are the ids of the objects that the classifier was trained on: class i + 1 is
    `classes[i]`, class 0 background. A removed object keeps its class, so that things that look
    like it are not taken for another object. `objects` maps the names of the present ones to ids.
    `files` are the checksums of all files by path; a folder that is being made has none yet.
    """

    objects: dict[str, WholeNumber]
    classes: tuple[WholeNumber, ...]
    settings: MethodSettings
    files: dict[str, str] = field(default_factory=dict)


def write_record(folder: Path, record: LearntRecord) -> None:
    """Write `learnt.json`. It is written last: a folder with one is complete."""
    write_json(folder / RECORD, fingerprints.sealed({"format": FORMAT, **asdict(record)}))


def read_record(folder: Path) -> LearntRecord:
    """Read `learnt.json`; whatever is opened in the folder after that lies in it.

    Raises MissingFileError, DamagedError, and DataError for what another version wrote.
    """
    path = folder / RECORD
    if not path.is_file():
        raise MissingFileError(f"{folder} holds no learnt objects: it has no {RECORD}")
    own_files(folder)
    try:
        content = read_json(path)
    except DataError as error:
        raise DamagedError(f"{error}: {_AGAIN}") from error
    fields = content if isinstance(content, dict) else {}
    known = fields.get("format") == FORMAT
    if (known or fingerprints.SEAL in fields) and not fingerprints.seal_is_whole(fields):
        raise DamagedError(f"{path} is damaged: {_AGAIN}")
    if not known:
        raise DataError(
            f"{path}: format is {str(fields.get('format'))[:60]}, this version of HLP reads "
            f"{FORMAT}: learn the objects again, or install the version that wrote it"
        )
    try:
        record = stored_as(LearntRecord, fields, str(path))
    except ConfigError as error:  # a plug-in that is not installed here
        raise DataError(f"{path}: {error}") from error
    for name in record.objects:
        if not NAME.fullmatch(name):
            raise DataError(f"{path}: {name!r} cannot name an object")
    ids, classes = [*record.objects.values()], record.classes
    distinct = len({*ids}) == len(ids) > 0 and len({*classes}) == len(classes)
    if not distinct or not {*ids} <= {*classes}:
        raise DataError(f"{path}: ids {ids}, classes {[*classes]}: each has one: {_AGAIN}")
    return record


def check_files(folder: Path, record: LearntRecord, part: str = "") -> None:
    """Compare the files below a part of the folder with their checksums.

    Raises MissingFileError and DamagedError naming the file.
    """
    below = f"{part}/" if part else ""
    own = {name: checksum for name, checksum in record.files.items() if name.startswith(below)}
    for name in fingerprints.find_damaged(folder, own):
        if not (folder / name).is_file():
            raise MissingFileError(f"{folder / name} is missing: {_AGAIN}")
        raise DamagedError(f"{folder / name} is damaged: {_AGAIN}")


class LearntFolder:
    """Learnt objects on disk as `LearntObjects` for detection; files are read when first needed.

    Before that they are compared with their checksums, once: the loaders raise MissingFileError or
    DamagedError naming a file. `settings` are those of learning, except for `threads` and `device`
    if given. `record` is that of a folder which is not complete yet.
    """

    def __init__(
        self,
        folder: Path,
        threads: int | None = None,
        device: Device | None = None,
        record: LearntRecord | None = None,
    ) -> None:
        self.folder = folder
        self.record = read_record(folder) if record is None else record
        machine = self.record.settings.machine
        if threads is not None:
            machine = replace(machine, threads=threads)
        if device is not None:
            machine = replace(machine, device=device)
        self.settings = replace(self.record.settings, machine=machine)
        self._names = {object_id: name for name, object_id in self.record.objects.items()}
        self._checked: set[str] = set()

    @cached_property
    def models(self) -> dict[int, ObjectModel]:
        """Object models by id."""
        return {i: read_model(self.object_folder(i)) for i in sorted(self._names)}

    @property
    def classes(self) -> Sequence[int]:
        """Object id of each class of the classifier, from class 1 on."""
        return self.record.classes

    def object_folder(self, object_id: int) -> Path:
        """The folder of an object."""
        return self._part(f"{OBJECTS}/{self._names[object_id]}")

    def _part(self, name: str) -> Path:
        if name not in self._checked:
            check_files(self.folder, self.record, name)
            self._checked.add(name)
        return self.folder / name

    def load_classifier(self) -> Network:
        """The classifier of holistic patches."""
        network = load_classifier(self._part(CLASSIFIER), self.settings.machine)
        if network.outputs != len(self.classes) + 1:
            stated = f"{len(self.classes)} classes, the classifier has {network.outputs - 1}"
            raise DamagedError(f"{self.folder / RECORD}: {stated}: {_AGAIN}")
        return network

    def load_encoder(self) -> Encoder:
        """The encoder of local patches."""
        machine = self.settings.machine
        return self.settings.encoder.load(self._part(ENCODER), machine.threads, machine.device)

    def load_codebook(self, object_id: int) -> Codebook:
        """The codebook of one object."""
        return load_codebook(self.object_folder(object_id))

    def search_folder(self, object_ids: Sequence[int]) -> Path:
        """The folder for the search in the codebooks of these objects; it may hold nothing."""
        if is_joint(self.settings.codebook):
            return self._part(_searches_part(object_ids))
        (object_id,) = object_ids
        return self.object_folder(object_id)


def _searches_part(object_ids: Sequence[int]) -> str:
    """Where in a folder the search in the codebooks of several objects lies."""
    return f"{SEARCHES}/{fingerprints.content_checksum(repr(list(object_ids)).encode())[:8]}"


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
        _, features = load_codebooks(learnt, members)
        part = _searches_part(members)
        (folder / part).mkdir(parents=True, exist_ok=True)
        settings.codebook.prepare(features, settings.seed, folder / part)
        written = fingerprints.folder_checksums(folder / part)
        files |= {f"{part}/{name}": checksum for name, checksum in written.items()}
    return files
