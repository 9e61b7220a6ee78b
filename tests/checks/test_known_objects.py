from dataclasses import replace

import numpy as np

from hlp.checks.known_objects import all_answers, colored_answers
from hlp.data.synthetic.objects import demo_objects
from hlp.method.find.detections import Detection, Rejection, SearchResult
from hlp.refinement.pose_fit import PoseFit

BEAR = next(each for each in demo_objects().values() if each.name == "bear")
GREY = replace(BEAR, mesh=replace(BEAR.mesh, colored=False))


def answer(relief=0.9, slope=0.9):
    fit = PoseFit(0.2, relief, slope, 1.0, 1.0)
    return Detection("bear", 0.1, np.eye(4), 1.0, 0.0, 1.0, np.eye(4)[None], None, fit)


def test_answers_that_were_not_good_enough_count_too():
    first, second = answer(), answer(0.5)
    found = SearchResult([first], [Rejection("a", "low", second), Rejection("b", "none", None)])
    assert all_answers(found) == [first, second]


def test_colours_are_compared_where_the_shape_fits():
    answers = [answer(), answer(relief=0.7), answer(slope=0.7)]
    assert colored_answers({"bear": BEAR}, answers) == answers[:1]
    assert colored_answers({"bear": GREY}, answers) == []
