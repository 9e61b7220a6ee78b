"""The picture of an oracle matrix."""

import numpy as np

from hlp.reporting.figures.basin_maps import oracle_map


def test_every_cell_has_its_recall() -> None:
    recalls = np.array([[0.25, 0.5], [1.0, 0.0], [0.625, 0.25]])  # cat, can, all targets
    cells = [
        {
            "region": region,
            "coarse": "noisy",
            "add": {"recall": recalls[2, column]},
            "per_object": {
                name: {"recall": recalls[row, column]} for row, name in enumerate(("cat", "can"))
            },
        }
        for column, region in enumerate(("estimated", "true"))
    ]
    lost = {"region": 0.01, "coarse pose": -0.02}
    figure = oracle_map({"frames": 3, "cells": cells, "lost": lost})
    (ax,) = figure.axes
    np.testing.assert_array_equal(ax.images[0].get_array(), recalls)
    assert ax.images[0].get_clim() == (0.0, 1.0)
    written = [text.get_text() for text in ax.texts]
    assert written == [f"{recall:.3f}" for recall in recalls.ravel()]
    assert [label.get_text() for label in ax.get_xticklabels()] == ["est/true±", "true/true±"]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["cat", "can", "all targets"]
    title = figure.get_suptitle()
    assert title.endswith("Lost by each stage: region +0.010, coarse pose -0.020")
