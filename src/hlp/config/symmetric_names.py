"""Whether `evaluation.symmetric` names objects that there are."""

import logging
from collections.abc import Sequence

from hlp.errors import ConfigError
from hlp.evaluation.settings import EvaluationSettings
from hlp.reporting.paper_results import ADD_BY_OBJECT

_MOST = 8  # names that a message shows


def check_symmetric(settings: EvaluationSettings, objects: Sequence[str]) -> None:
    """Compare the names with those of the data set's objects.

    A policy for LINEMOD names objects that a part of LINEMOD lacks; where it names none of the
    objects at all, as where they are numbered, a warning says so. Raises ConfigError for a name
    that is neither an object's nor one of LINEMOD's.
    """
    named = settings.symmetric or ()
    there = ", ".join(objects[:_MOST]) + (", …" if len(objects) > _MOST else "")
    numbered = [name for name in named if name.startswith("obj_") and name[4:].isdecimal()]
    unknown = [name for name in named if name not in {*objects, *ADD_BY_OBJECT, *numbered}]
    if unknown:
        raise ConfigError(
            f"evaluation.symmetric names {', '.join(unknown)}, which no object is called (objects: "
            f"{there})"
        )
    if named and not {*named} & {*objects}:
        logging.getLogger(__name__).warning(
            "evaluation.symmetric: no object is called %s (objects: %s), so none counts as "
            "symmetric; LINEMOD's by number: evaluation=bop_numbers, those of models_info.json: "
            "evaluation=symmetries",
            " or ".join(named),
            there,
        )
