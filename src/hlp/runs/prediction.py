"""`hlp predict`: all instances of learnt objects in a user's own frames, written as they come."""

import hashlib
import logging
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from annotated_types import Ge, Interval
from jaxtyping import Bool
from tqdm import tqdm

import hlp
from hlp.data.own_frames import OwnFrames, SearchMasks
from hlp.errors import DamagedError, DataError, HlpError, MissingFileError
from hlp.method.detector import MOST_INSTANCES, Detector
from hlp.method.find.detections import Detection, SearchResult
from hlp.method.learn.learnt_folder import RECORD
from hlp.method.track.tracking import TrackedDetection, TrackingResult, TrackingSettings
from hlp.records import Frame, ObjectModel, PoseEstimate, parse_frame_key
from hlp.refinement.score_model import MIN_SCORE
from hlp.reporting import answers
from hlp.results.answers_file import LINES, AnswersFile
from hlp.runs.fault_watch import FaultWatch
from hlp.settings import Doc, Settings

_AHEAD = 2  # frames decoded beside detection
_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class PredictionOptions(Settings):
    """What is looked for and drawn; the rest lies in the learnt folder."""

    objects: Annotated[list[str] | None, Doc("names; null: all learnt ones")] = None
    max_instances: Annotated[int, Ge(1), Doc("of each object")] = MOST_INSTANCES
    min_score: Annotated[
        float, Interval(ge=0, le=1), Doc("probability below which a pose is no answer")
    ] = MIN_SCORE
    track: Annotated[bool, Doc("the frames are a sequence: follow objects from frame to frame")] = (
        False
    )
    panels: Annotated[
        int | None,
        Ge(0),
        Doc("frames that are drawn, spread evenly; null: one frame is, several are not"),
    ] = None


def predict(
    detector: Detector,
    frames: OwnFrames,
    output: Path,
    options: PredictionOptions,
    masks: SearchMasks | None = None,
) -> int:
    """Find objects in every frame; the number of frames that could be processed.

    Writes poses.csv, poses.jsonl and, last, poses.json into `output`, and prints a line for each
    answer. A call that was stopped is continued by the same one, but for tracking. The next frames
    are decoded beside detection. A frame that cannot be used costs itself alone: it is logged, and
    a line of poses.jsonl names its error. Raises DataError if there is no other, and DamagedError
    or MissingFileError for a file of what is learnt.
    """
    drawn = _drawn(frames.keys, options.panels)
    search = _tracking(detector, options) if options.track else _detection(detector, options)
    request = "" if options.track else _request(detector, frames, options, masks)
    answered = 0
    watch = FaultWatch(detector, options.objects)
    with AnswersFile(output, request) as file:
        failed = sum(not used for used in file.answered.values())
        left = [key for key in frames.keys if parse_frame_key(key) not in file.answered]
        if file.answered:
            _logger.info("%d of %d frames are answered already", len(file.answered), len(frames))
        for key, frame, mask, error in _counted(_decoded(frames, left, masks), len(left)):
            problem = error
            if frame is not None:
                try:
                    found = search(frame, mask)
                    if answered == 0:  # after what decoding and loading had to say
                        _say(answers.HEADER)
                    _write(file, detector, frames, frame, found)
                    answered += 1
                    if key in drawn:
                        _draw(output, detector.models, frames.paths(key).name, frame, found)
                except (DamagedError, MissingFileError):  # of what is learnt, not of the frame
                    raise
                except HlpError as wrong:
                    problem = wrong
                else:  # what goes wrong in there is no fault of the frame, which has its answers
                    with tqdm.external_write_mode():
                        watch.add(frame, found)
            if problem is not None:
                if len(frames) == 1:
                    raise problem
                failed += 1
                with tqdm.external_write_mode():
                    _logger.warning("%s", problem)
                file.add(_failure(frames, key, problem), None)
        watch.end()
    if failed == len(frames):
        raise DataError(f"none of the {failed} frames can be used; see {output / LINES}")
    if failed:
        _logger.warning("%d of %d frames could not be used", failed, len(frames))
    return len(frames) - failed


def _request(
    detector: Detector,
    frames: OwnFrames,
    options: PredictionOptions,
    masks: SearchMasks | None,
) -> str:
    """Identifies all that decides the answers: version, learnt objects, options, and files."""
    digest = hashlib.blake2b((detector.folder / RECORD).read_bytes(), digest_size=16)
    digest.update(f"{hlp.__version__} {options} {frames.settings} {masks}\n".encode())
    named = [frames.settings.intrinsics, frames.settings.depth_intrinsics, masks and masks.masks]
    paths = [frames.paths(key) for key in frames.keys]
    files = [path for each in paths for path in (each.color, each.depth)]
    for path in dict.fromkeys([*(Path(str(each)) for each in named), *files]):
        about = path.stat() if path.exists() else None  # intrinsics may be numbers
        digest.update(f"{path} {about and (about.st_size, about.st_mtime_ns)}\n".encode())
    return digest.hexdigest()


_Found = SearchResult | TrackingResult
_Search = Callable[[Frame, Bool[np.ndarray, "h w"] | None], _Found]


def _detection(detector: Detector, options: PredictionOptions) -> _Search:
    def search(frame: Frame, mask: Bool[np.ndarray, "h w"] | None) -> SearchResult:
        return detector.search(
            frame.rgb,
            frame.depth,
            frame.camera_matrix,
            options.objects,
            options.max_instances,
            options.min_score,
            mask,
        )

    return search


def _tracking(detector: Detector, options: PredictionOptions) -> _Search:
    settings = TrackingSettings(min_score=options.min_score)
    return detector.tracker(options.objects, options.max_instances, settings).search


Decoded = tuple[str, Frame | None, Bool[np.ndarray, "h w"] | None, HlpError | None]


def _decoded(
    frames: OwnFrames, keys: Sequence[str], masks: SearchMasks | None
) -> Iterator[Decoded]:
    """Each frame or its error, in order; a few of the next ones are decoded meanwhile."""

    def decode(key: str) -> Decoded:
        try:
            frame = frames.load(key)
            mask = None if masks is None else masks.load(frames.paths(key), frame.depth.shape)
            return key, frame, mask, None
        except HlpError as error:
            return key, None, None, error

    waiting: list[Future[Decoded]] = []
    with ThreadPoolExecutor(1) as decoder:
        for key in keys:
            waiting.append(decoder.submit(decode, key))
            if len(waiting) > _AHEAD:
                yield waiting.pop(0).result()
        for future in waiting:
            yield future.result()


def _counted(decoded: Iterator[Decoded], frames: int) -> Iterator[Decoded]:
    """The same, counted on a line of the terminal if there are several."""
    hidden = None if frames > 1 else True
    yield from tqdm(decoded, "poses", frames, unit="frame", disable=hidden)


def _say(line: str) -> None:
    """Print a line of the results above the line that counts frames."""
    with tqdm.external_write_mode():
        print(line, flush=True)


def _write(
    file: AnswersFile, detector: Detector, frames: OwnFrames, frame: Frame, found: _Found
) -> None:
    image = frames.paths(frame.key)
    models = detector.models
    rejected = [each.answer for each in found.rejections if each.answer is not None]
    seconds = sum(each.seconds for each in [*found.detections, *rejected])
    for each in found.detections:
        model = models[each.object]
        estimate = PoseEstimate(
            frame.scene_id,
            frame.frame_id,
            model.object_id,
            each.pose_cam_obj,
            each.score,
            {"total": seconds},
        )
        values = _values(str(image.color), frame, model, True, seconds) | _described(each)
        file.add(values, estimate)
        _say(answers.pose_line(image.name, each.object, each.score, each.pose_cam_obj))
    named = {each.object for each in found.detections}
    for rejection in found.rejections:
        if rejection.object in named:  # one more instance that was looked for in vain
            continue
        model = models[rejection.object]
        values = _values(str(image.color), frame, model, False, seconds)
        best = {"score": 0.0} if rejection.answer is None else _described(rejection.answer)
        file.add(values | best | {"reason": rejection.reason}, None)
        _say(answers.missing_line(image.name, rejection.object, rejection.reason))
        named.add(rejection.object)


def _values(
    image: str, frame: Frame, model: ObjectModel, found: bool, seconds: float
) -> dict[str, object]:
    ids = (frame.scene_id, frame.frame_id)
    return answers.answer_values(image, ids, (model.object_id, model.name), found, seconds)


def _described(detection: Detection) -> dict[str, object]:
    values: dict[str, object] = {
        "score": detection.score,
        **answers.pose_values(detection.pose_cam_obj),
        "visible_fraction": detection.visible_fraction,
        "residual_mm": detection.residual_mm,
    }
    if isinstance(detection, TrackedDetection):
        values |= {"track": detection.track, "tracked": detection.tracked}
    return values


def _failure(frames: OwnFrames, key: str, error: HlpError) -> dict[str, object]:
    scene_id, frame_id = parse_frame_key(key)
    image = str(frames.paths(key).color)
    return {"rgb": image, "scene_id": scene_id, "im_id": frame_id, "error": str(error)}


def _drawn(keys: Sequence[str], panels: int | None) -> set[str]:
    count = (1 if len(keys) == 1 else 0) if panels is None else min(panels, len(keys))
    return {keys[i * len(keys) // count] for i in range(count)}


def _draw(
    output: Path, models: dict[str, ObjectModel], name: str, frame: Frame, found: _Found
) -> None:
    from hlp.reporting.figures.panels import (  # not needed for a folder
        draw_detections,
        write_picture,
    )

    poses = [(models[each.object], each.pose_cam_obj) for each in found.detections]
    folder = output / "panels"
    folder.mkdir(exist_ok=True)
    write_picture(folder / f"{name}.png", draw_detections(frame, poses))
