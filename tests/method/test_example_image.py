import numpy as np

from hlp.data.synthetic.objects import demo_objects
from hlp.method.arguments import checked_frame
from hlp.method.pyfunc_model import example_image


def test_the_example_shows_the_whole_object_in_the_middle() -> None:
    for model in demo_objects().values():
        image = example_image(model)
        checked_frame(image.rgb, image.depth, image.camera_matrix)
        seen = image.depth < image.depth.max()
        assert 0.01 < seen.mean() < 0.5
        assert not np.concatenate([seen[0], seen[-1], seen[:, 0], seen[:, -1]]).any()
        row, column = np.argwhere(seen).mean(axis=0)
        assert abs(row - 60) < 15 and abs(column - 80) < 15
        nearest, farthest = image.depth[seen].min(), image.depth[seen].max()
        assert 0.0 < farthest - nearest < model.diameter
