from types import SimpleNamespace

import numpy as np
import pytest

from hlp.data.synthetic.objects import demo_objects
from hlp.errors import InputError
from hlp.method.arguments import checked_frame
from hlp.method.pyfunc_model import PosesOfImages, example_image


class OnePerImage:
    """In place of a detector: an object whose score is the first pixel's red."""

    def detect(self, rgb, depth, camera_matrix, **options):
        assert rgb.shape == (2, 3, 3) and depth.shape == (2, 3) and camera_matrix.shape == (3, 3)
        assert options == {"max_instances": 1}
        found = {"score": float(rgb[0, 0, 0]), "visible_fraction": 0.5, "seconds": 0.25}
        return [SimpleNamespace(object="cat", pose_cam_obj=np.eye(4), residual_mm=1.0, **found)]


def images(count):
    rgb = np.zeros((count, 2, 3, 3), np.uint8)
    rgb[:, 0, 0, 0] = np.arange(count)
    return {
        "rgb": rgb,
        "depth": np.ones((count, 2, 3), np.float32),
        "camera_matrix": np.stack([np.eye(3)] * count),
    }


def test_rows_name_their_image():
    model = PosesOfImages(OnePerImage())
    rows = model.predict(images(2), {"max_instances": 1})
    assert [(row["image"], row["object"], row["score"]) for row in rows] == [
        (0, "cat", 0.0),
        (1, "cat", 1.0),
    ]
    assert rows[0]["pose_cam_obj"] == np.eye(4).tolist() and "residual_mm" not in rows[0]


def test_images_of_which_there_are_too_few_are_named():
    model = PosesOfImages(OnePerImage())
    with pytest.raises(InputError, match="'depth': 1"):
        model.predict({**images(2), "depth": images(1)["depth"]})


@pytest.mark.parametrize("model", demo_objects().values(), ids=lambda model: model.name)
def test_the_example_shows_the_whole_object_in_the_middle(model):
    image = example_image(model)
    checked_frame(image.rgb, image.depth, image.camera_matrix)
    seen = image.depth < image.depth.max()
    assert 0.01 < seen.mean() < 0.5
    assert not np.concatenate([seen[0], seen[-1], seen[:, 0], seen[:, -1]]).any()
    row, column = np.argwhere(seen).mean(axis=0)
    assert abs(row - 60) < 15 and abs(column - 80) < 15
    nearest, farthest = image.depth[seen].min(), image.depth[seen].max()
    assert 0.0 < farthest - nearest < model.diameter
