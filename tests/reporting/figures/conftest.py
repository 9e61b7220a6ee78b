import pytest

from box_scene import box_frame, box_model
from hlp.records import Frame, ObjectModel


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return box_model()


@pytest.fixture(scope="module")
def shot(box: ObjectModel) -> Frame:
    return box_frame(box)
