"""`hlp predict`: all instances of learnt objects in a user's own frames, written as they come."""

import hashlib
import logging
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
from annotated_types import Ge
from tqdm import tqdm

import hlp
from hlp.arrays import Mask, Pose, spread
from hlp.checks.known_objects import FaultWatch, all_answers
from hlp.data.own_frames import OwnFrames, SearchMasks
from hlp.errors import DamagedError, DataError, HlpError, MissingFileError
from hlp.method.arguments import checked_names
from hlp.method.detector import Detector
from hlp.method.find.detections import Detection, SearchResult, TrackedDetection, TrackingResult
from hlp.method.find.search import MOST_INSTANCES
from hlp.method.learn.learnt_folder import RECORD
from hlp.method.settings import TrackingSettings
from hlp.progress import Progress
from hlp.records import MILLIMETRES_PER_METRE, Frame, PoseEstimate, parse_frame_key
from hlp.refinement.score_model import MIN_SCORE
from hlp.results.poses_file import LINES, AnswersFile
from hlp.settings import Count, Doc, Settings, Share

HEADER = (
    f"{'frame':<24} {'object':<16} {'score':>5} {'x mm':>8} {'y mm':>8} {'z mm':>8} "
    f"{'rx deg':>7} {'ry deg':>7} {'rz deg':>7}"
)
"""Above the lines of `pose_line`."""
_AHEAD = 2  # frames decoded beside detection
_logger = logging.getLogger(__name__)
_Found = SearchResult | TrackingResult
_Search = Callable[[Frame, Mask | None], _Found]
_Decoded = tuple[str, Frame | None, Mask | None, HlpError | None]


def pose_line(image: str, name: str, score: float, pose: Pose) -> str:
    """Image, object, score, translation (mm) and rotation vector (degrees).

    The rotation vector points along the axis of rotation, and its length is the angle.
    """
    shift = " ".join(f"{value:8.1f}" for value in pose[:3, 3] * MILLIMETRES_PER_METRE)
    angles = np.rad2deg(cv2.Rodrigues(pose[:3, :3])[0].ravel())
    turn = " ".join(f"{value:7.1f}" for value in angles)
    return f"{image:<24} {name:<16} {score:5.2f} {shift} {turn}"


def detection_values(found: Detection) -> dict[str, Any]:
    """Score, pose and fit; the pose with BOP's keys: `cam_R_m2c` by rows, `cam_t_m2c` in mm.

    Also the place in the order of picking, and in a sequence the track.
    """
    pose = np.asarray(found.pose_cam_obj, dtype=np.float64)
    values: dict[str, Any] = {
        "score": found.score,
        "cam_R_m2c": pose[:3, :3].ravel().tolist(),
        "cam_t_m2c": (pose[:3, 3] * MILLIMETRES_PER_METRE).tolist(),
        "visible_fraction": found.visible_fraction,
        "residual_mm": found.residual_mm,
    }
    if found.rank is not None:
        values["rank"] = found.rank
    if isinstance(found, TrackedDetection):
        values |= {"track": found.track, "tracked": found.tracked}
    return values


@dataclass(frozen=True, kw_only=True)
class PredictionOptions(Settings):
    """What is looked for and drawn; the rest lies in the learnt folder."""

    objects: Annotated[list[str] | None, Doc("names; null: all learnt ones")] = None
    max_instances: Annotated[Count, Doc("of each object")] = MOST_INSTANCES
    min_score: Annotated[Share, Doc("poses of a lower score are rejected")] = MIN_SCORE
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
    are decoded beside detection. Only a frame that cannot be used is lost: it is logged, and
    a line of poses.jsonl names its error. Raises DataError if there is no other, and DamagedError
    or MissingFileError for a file of what is learnt; InputError for a name of none.
    """
    call = _Call(detector, frames, output, options)
    request = "" if options.track else _request(detector, frames, options, masks)
    with AnswersFile(output, request) as file, ThreadPoolExecutor(1) as decoder:
        failed = sum(not used for used in file.answered.values())
        left = [key for key in frames.keys if parse_frame_key(key) not in file.answered]
        if file.answered:
            _logger.info("%d of %d frames are answered already", len(file.answered), len(frames))
        decoded = _decoded(decoder, frames, left, masks)
        progress = Progress(decoded, "poses", len(left), unit="frame", bar=len(left) > 1)
        for key, frame, mask, error in progress:
            problem = error if frame is None else call.answer(frame, mask, file)
            if problem is not None:
                if len(frames) == 1:
                    raise problem
                failed += 1
                with tqdm.external_write_mode():
                    _logger.warning("%s", problem)
                file.add({**_names(frames, key), "error": str(problem)}, None)
        call.watch.end()
    if failed == len(frames):
        raise DataError(f"none of the {failed} frames can be used; see {output / LINES}")
    if failed:
        _logger.warning("%d of %d frames could not be used", failed, len(frames))
    return len(frames) - failed


def _request(
    detector: Detector, frames: OwnFrames, options: PredictionOptions, masks: SearchMasks | None
) -> str:
    """Identifies all that decides the answers: version, learnt objects, options, and files."""
    digest = hashlib.blake2b((detector.folder / RECORD).read_bytes(), digest_size=16)
    digest.update(f"{hlp.__version__} {options} {frames.settings} {masks}\n".encode())
    named = [frames.settings.intrinsics, frames.settings.depth_intrinsics, masks and masks.masks]
    images = [frames.paths(key) for key in frames.keys]
    files = [path for image in images for path in (image.color, image.depth)]
    for path in dict.fromkeys([*(Path(str(name)) for name in named), *files]):
        about = path.stat() if path.exists() else None  # intrinsics may be numbers
        digest.update(f"{path} {about and (about.st_size, about.st_mtime_ns)}\n".encode())
    return digest.hexdigest()


def _decoded(
    decoder: ThreadPoolExecutor, frames: OwnFrames, keys: Sequence[str], masks: SearchMasks | None
) -> Iterator[_Decoded]:
    """Each frame or its error, in order; a few of the next ones are decoded meanwhile."""

    def decode(key: str) -> _Decoded:
        try:
            frame = frames.load(key)
            mask = None if masks is None else masks.load(frames.paths(key), frame.depth.shape)
            return key, frame, mask, None
        except HlpError as error:
            return key, None, None, error

    waiting: list[Future[_Decoded]] = []
    for key in keys:
        waiting.append(decoder.submit(decode, key))
        if len(waiting) > _AHEAD:
            yield waiting.pop(0).result()
    for future in waiting:
        yield future.result()


def _names(frames: OwnFrames, key: str) -> dict[str, Any]:
    """What every line states: the image, and BOP's numbers of scene and image."""
    scene_id, frame_id = parse_frame_key(key)
    return {"rgb": str(frames.paths(key).color), "scene_id": scene_id, "im_id": frame_id}


class _Call:
    """Finds objects in one frame after the other, and writes, prints and draws what it finds."""

    def __init__(
        self, detector: Detector, frames: OwnFrames, output: Path, options: PredictionOptions
    ) -> None:
        self._detector, self._frames, self._output = detector, frames, output
        _ = frames.camera  # what is wrong with it, or a name, is wrong with every frame
        if options.objects is not None:
            checked_names(options.objects, detector.objects, detector.folder)
        self._search = _search(detector, options)
        panels = int(len(frames) == 1) if options.panels is None else options.panels
        self._drawn = set(spread(frames.keys, panels))
        self._answered = 0
        self.watch = FaultWatch(detector, options.objects)

    def answer(self, frame: Frame, mask: Mask | None, file: AnswersFile) -> HlpError | None:
        """Answer a frame; its error, if it cannot be used."""
        try:
            found = self._search(frame, mask)
            if self._answered == 0:  # after what decoding and loading had to say
                _say(HEADER)
            self._write(frame, found, file)
            self._answered += 1
            if frame.key in self._drawn:
                self._draw(frame, found)
        except (DamagedError, MissingFileError):  # of what is learnt, not of the frame
            raise
        except HlpError as error:
            return error
        with tqdm.external_write_mode():  # what goes wrong in there is no fault of the frame
            self.watch.add(frame, found)
        return None

    def _write(self, frame: Frame, found: _Found, file: AnswersFile) -> None:
        """Write and print the answers, then why objects of which there is none were not found."""
        image, models = self._frames.paths(frame.key).name, self._detector.models
        seconds = {"total": sum(answer.seconds for answer in all_answers(found))}

        def about(name: str, is_found: bool) -> dict[str, Any]:
            known = {"obj_id": models[name].object_id, "object": name, "found": is_found}
            return {**_names(self._frames, frame.key), **known, "seconds": seconds}

        for answer in found.detections:
            values = about(answer.object, True) | detection_values(answer)
            ids = (frame.scene_id, frame.frame_id, models[answer.object].object_id)
            file.add(values, PoseEstimate(*ids, answer.pose_cam_obj, answer.score, seconds))
            _say(pose_line(image, answer.object, answer.score, answer.pose_cam_obj))
        named = {answer.object for answer in found.detections}
        for rejection in found.rejections:
            if rejection.object in named:  # one more instance that was looked for in vain
                continue
            best = {"score": 0.0} if (r := rejection.answer) is None else detection_values(r)
            file.add({**about(rejection.object, False), **best, "reason": rejection.reason}, None)
            _say(f"{image:<24} {rejection.object:<16} not found: {rejection.reason}")
            named.add(rejection.object)

    def _draw(self, frame: Frame, found: _Found) -> None:
        # Not needed for a folder.
        from hlp.reporting.figures.panels import draw_detections, write_picture

        models, name = self._detector.models, self._frames.paths(frame.key).name
        poses = [(models[answer.object], answer.pose_cam_obj) for answer in found.detections]
        write_picture(self._output / "panels" / f"{name}.png", draw_detections(frame, poses))


def _search(detector: Detector, options: PredictionOptions) -> _Search:
    if options.track:
        settings = TrackingSettings(min_score=options.min_score)
        return detector.tracker(options.objects, options.max_instances, settings).search
    of = options.objects, options.max_instances, options.min_score
    return lambda frame, mask: detector.search(
        frame.rgb, frame.depth, frame.camera_matrix, *of, mask
    )


def _say(line: str) -> None:
    """Print a line of the results above the line that counts frames."""
    with tqdm.external_write_mode():
        print(line, flush=True)
