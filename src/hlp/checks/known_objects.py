"""Answers to a frame as evidence about the frame itself."""

from collections.abc import Mapping, Sequence

from hlp.method.find.detections import Detection, SearchResult
from hlp.method.track.tracking import TrackingResult
from hlp.records import ObjectModel

_SHAPE_FITS = 0.8  # correlation of relief and of slope: wrong poses rarely reach it


def all_answers(found: SearchResult | TrackingResult) -> list[Detection]:
    """Detections and what was not good enough: a fault of the frame lowers the score."""
    return [*found.detections, *(each.answer for each in found.rejections if each.answer)]


def colored_answers(
    models: Mapping[str, ObjectModel], answers: Sequence[Detection]
) -> list[Detection]:
    """Poses of objects with colours whose shape fits. `models` are by the names of the answers."""
    return [
        each
        for each in answers
        if models[each.object].mesh.colored and min(each.fit.relief, each.fit.slope) >= _SHAPE_FITS
    ]
