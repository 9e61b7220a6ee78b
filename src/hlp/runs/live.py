"""`hlp live`: an answer to each image of a camera as it comes, as a line of JSON."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge

from hlp.data.cameras.camera import BrokenImage, Camera
from hlp.errors import HlpError
from hlp.method.detector import Detector
from hlp.method.find.detections import Rejection
from hlp.method.track.tracker import Tracker
from hlp.method.track.tracking import TrackedDetection, TrackingResult, TrackingSettings
from hlp.records import CameraImage
from hlp.rendering.light import FRONTAL_LIGHT
from hlp.rendering.rasterizer import render_rgbd
from hlp.reporting.answers import pose_values
from hlp.runs.live_pictures import LivePictures
from hlp.settings import Doc

Line = Mapping[str, Any]
_REHEARSAL_CAMERA = np.array([[600.0, 0.0, 319.5], [0.0, 600.0, 239.5], [0.0, 0.0, 1.0]])
_REHEARSAL_SHAPE = (480, 640)


@dataclass(frozen=True, kw_only=True)
class LiveOptions(TrackingSettings):
    """What is looked for in the images of a camera, and how it is tracked."""

    objects: Annotated[list[str] | None, Doc("names; null: all learnt ones")] = None
    max_instances: Annotated[int, Ge(1), Doc("of each object")] = 1


def live(
    detector: Detector,
    camera: Camera,
    options: LiveOptions,
    answer: Callable[[Line], None],
    pictures: LivePictures | None = None,
) -> None:
    """Answer each image of a camera until it ends.

    The first line says that everything is loaded. An image that cannot be used costs itself alone:
    its line has an `error`. The lines' fields are described in docs/live.md.
    """
    tracker = detector.tracker(options.objects, options.max_instances, options)
    _rehearse(detector, tracker)
    names = list(detector.objects if options.objects is None else options.objects)
    answer({"ready": True, "objects": names})
    for number, image in enumerate(camera):
        begun = time.perf_counter()
        try:
            if isinstance(image, BrokenImage):
                raise image.error
            result = tracker.search(image)
        except HlpError as error:
            answer({"image": number, "name": image.name, "error": str(error)})
            continue
        milliseconds = (time.perf_counter() - begun) * 1000.0
        answer(_line(number, image, result, milliseconds))
        if pictures is not None:
            pictures.show(image, result.detections)


def _rehearse(detector: Detector, tracker: Tracker) -> None:
    """Search and track once in a rendered image, so that the first real one takes no longer."""
    detector.warm_up()
    model = next(iter(detector.models.values()))
    pose = np.eye(4)
    pose[:3, 3] = np.array([0.0, 0.0, 4.0 * model.diameter]) - model.centroid
    rgb, depth = render_rgbd(model.mesh, pose, _REHEARSAL_CAMERA, _REHEARSAL_SHAPE, FRONTAL_LIGHT)
    wall = np.where(depth > 0.0, depth, 6.0 * model.diameter).astype(np.float32)
    for _ in range(2):
        tracker.search(CameraImage(rgb, wall, _REHEARSAL_CAMERA))
    tracker.reset()


def _line(number: int, image: CameraImage, result: TrackingResult, milliseconds: float) -> Line:
    return {
        "image": number,
        "name": image.name,
        "captured": image.captured,
        "ms": round(milliseconds, 2),
        "found": [_found(each) for each in result.detections],
        "missing": [_missing(each) for each in result.rejections],
    }


def _found(each: TrackedDetection) -> Line:
    return {
        "object": each.object,
        "track": each.track,
        "tracked": each.tracked,
        "score": each.score,
        **pose_values(each.pose_cam_obj),
        "visible_fraction": each.visible_fraction,
        "residual_mm": each.residual_mm,
    }


def _missing(each: Rejection) -> Line:
    return {"object": each.object, "reason": each.reason}
