"""`hlp search`: Optuna looks for settings with the best ADD(-S) recall within a time limit.

work/search/<space>_<digest>/study.db   Optuna's study
work/search/<space>_<digest>/0, 1, …    the trials' results
"""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from hlp.arrays import derive_seed
from hlp.config.build import Run, with_changed_run
from hlp.config.settings import TASKS
from hlp.errors import ConfigError, MissingDependencyError, is_expected
from hlp.files import SCORES, write_json
from hlp.folders import locked
from hlp.reporting.comparison import paired_difference, surely
from hlp.reporting.figures import save_figure
from hlp.reporting.figures.charts import search_points
from hlp.reporting.mlflow.pages import short_name
from hlp.reporting.mlflow.run import flatten
from hlp.reporting.mlflow.tracking import ChildRun, as_child_run
from hlp.reporting.study_tables import format_search, write_search
from hlp.results.poses_file import read_scores
from hlp.results.recalls import TargetKey, add_verdicts
from hlp.runs import runner
from hlp.settings import Count, Doc, NotNegative, Settings
from hlp.stages.manifest import described, fingerprint
from hlp.studies.study_run import study_code, study_run

if TYPE_CHECKING:
    from optuna import Study
    from optuna.distributions import BaseDistribution

# Keys that change neither a trial's recall nor its time.
_NOT_SEARCHED = ("output", "work", "reporting", "panels", "task")
_RUN_ID, _TIME, _ERROR = "run_id", "time_ms", "error"
_KEY = "task.space.parameters"
Space = Mapping[str, "BaseDistribution"]
"""What may be changed, by dotted key."""


@dataclass(frozen=True, kw_only=True)
class SpaceSettings(Settings):
    """What a search may change."""

    name: Annotated[str, Doc("name of the space")]
    parameters: Annotated[
        dict[str, Any], Doc("ranges and choices, nested as in the whole configuration")
    ]


@TASKS.register
@dataclass(frozen=True, kw_only=True)
class SearchSettings(Settings):
    """Config group `task`: Optuna's search for the settings with the best ADD(-S) recall."""

    name: Literal["search"] = "search"
    trials: Annotated[
        Count, Doc("total number, with earlier calls; the first is the unchanged configuration (D)")
    ] = 30
    limit_ms: Annotated[
        NotNegative, Doc("limit of the best trial's median time per target (D)")
    ] = 500.0
    space: SpaceSettings

    def run(self, run: Run, output: Path) -> None:
        """Run trials until the study has `trials`; write search.json, .csv, .md, .png and .svg.

        Each trial is a run; the first is the unchanged configuration. One that fails (HlpError,
        OSError) is a FAILED run, and the search continues; one that was interrupted is repeated.
        Any other exception is a bug: it is raised, and its trial is not counted. Raises ConfigError
        if the space names a wrong setting or value, InputError if another process works on this.
        """
        if find_spec("optuna") is None:
            raise MissingDependencyError(
                "task=search needs the extra 'search': pip install 'hlp[search]'"
            )
        space = read_space(self.space.parameters)
        own = check_within(space, run.config)
        for changed in ({key: end} for key, of in space.items() for end in _ends(of)):
            with_changed_run(run, nested(changed))  # if ends are accepted, all others are
        folder = Path(run.settings.work).absolute() / "search" / _study_name(run, self)
        folder.mkdir(parents=True, exist_ok=True)
        with locked(folder / "study.lock", f"another process works on the search in {folder}"):
            study = _open(folder, run.settings.seed, own)
            with study_run(run, output, study.user_attrs.get(_RUN_ID)) as (_, tracker):
                study.set_user_attr(_RUN_ID, tracker.run_id)
                while len(_trials(study, folder)) < self.trials:
                    _try(study, run, self, space, folder, tracker.run_id)
                result = _result(self, _trials(study, folder))
                write_json(output / "search.json", result)
                write_search(output, result)
                if any(trial["error"] is None for trial in result["trials"]):
                    save_figure(search_points(result), output / "search")
        print(format_search(result))


def _verdicts(trial: Mapping[str, Any]) -> dict[TargetKey, float]:
    """Verdicts by ADD(-S) of a trial's targets; none if its files were removed since."""
    scores = Path(trial["folder"], SCORES)
    return add_verdicts(read_scores(scores)[0] if scores.is_file() else [])


def _study_name(run: Run, task: SearchSettings) -> str:
    """Name of the study; searches of the same name share their trials."""
    config = {key: value for key, value in run.config.items() if key not in _NOT_SEARCHED}
    settings = {"config": config, "space": task.space.parameters, "limit_ms": task.limit_ms}
    method, frames = run.settings.method, run.dataset.frames
    chosen = (method.encoder, method.codebook, method.voting, method.refinement)
    upstream, code = {"frames": run.dataset.frames_identity}, study_code(__name__, *chosen, frames)
    description = described(settings, upstream, run.settings.seed, code)
    return f"{task.space.name}_{fingerprint('search', description)}"


def _open(folder: Path, seed: int, own: Mapping[str, Any]) -> "Study":
    """The study on disk. Interrupted trials are queued again; a new study starts with `own`."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(
        storage=f"sqlite:///{folder / 'study.db'}",
        study_name=folder.name,
        direction="maximize",
        load_if_exists=True,
    )
    # Another seed for each start: with the same one a continued study would repeat its draws.
    study.sampler = optuna.samplers.TPESampler(seed=derive_seed(seed, len(study.trials)))
    if not study.trials:
        study.enqueue_trial(dict(own))
    for trial in study.get_trials(states=(optuna.trial.TrialState.RUNNING,)):
        study.tell(trial.number, state=optuna.trial.TrialState.FAIL)
        study.enqueue_trial(trial.params)
    return study


def _try(
    study: "Study", run: Run, task: SearchSettings, space: Space, folder: Path, parent: str
) -> None:
    """One trial, logged as a child of the search's MLflow run."""
    from optuna.trial import TrialState

    trial = study.ask(dict(space))
    values = {key: str(value) for key, value in trial.params.items()}
    say = logging.getLogger(__name__)
    say.info("\nTrial %d  %s", trial.number, " ".join(f"{key}={v}" for key, v in values.items()))
    changes = {**nested(trial.params), "task": {"name": "evaluate"}}
    try:
        name = short_name(values, (), f"trial {trial.number}")
        with as_child_run(ChildRun(name, parent, values, str(trial.number))):
            summary = runner.run_method(with_changed_run(run, changes), folder / str(trial.number))
    except Exception as error:
        if not is_expected(error):  # a bug says nothing about the settings
            raise
        say.error("trial %d failed: %s", trial.number, error)
        trial.set_user_attr(_ERROR, str(error))
        study.tell(trial, state=TrialState.FAIL)
        return
    time_ms = summary["timing_ms"]["total"]["median"]
    trial.set_constraint(_TIME, time_ms - task.limit_ms)
    trial.set_user_attr(_TIME, time_ms)
    study.tell(trial, summary["metrics"]["add"]["recall"])


def _trials(study: "Study", folder: Path) -> list[dict[str, Any]]:
    """Trials that ended, with a result or an error; not those that were interrupted."""
    return [
        {
            "trial": trial.number,
            "values": trial.params,
            "recall": trial.value,
            "time_ms": trial.user_attrs.get(_TIME),
            "error": trial.user_attrs.get(_ERROR),
            "folder": str(folder / str(trial.number)),
        }
        for trial in study.trials
        if {_TIME, _ERROR} & set(trial.user_attrs)
    ]


def _result(task: SearchSettings, trials: list[dict[str, Any]]) -> dict[str, Any]:
    """Content of `search.json`: all trials, and the best one within the limit (None: no trial).

    That is the unchanged configuration, the first trial, unless another is surely better.
    """
    within = [t for t in trials if t["error"] is None and t["time_ms"] <= task.limit_ms]
    best = max(within, key=lambda trial: (trial["recall"], -trial["time_ms"]), default=None)
    if best is not None and within[0]["trial"] == 0:
        gain = paired_difference(_verdicts(within[0]), _verdicts(best))
        best = within[0] if gain is not None and not surely(gain) else best
    return {"space": task.space.name, "limit_ms": task.limit_ms, "best": best, "trials": trials}


def read_space(parameters: Mapping[str, Any]) -> dict[str, "BaseDistribution"]:
    """Ranges and choices as Optuna's distributions, of mappings nested as the configuration.

    Raises ConfigError naming a key that has neither `low` and `high` nor `choices`, or that leaves
    no choice.
    """
    given: dict[str, dict[str, Any]] = {}
    for key, value in flatten(parameters).items():
        name, _, word = key.rpartition(".")
        given.setdefault(name, {})[word] = value
    space = {}
    for name, words in given.items():
        try:
            space[name] = _distribution(words)
        except (TypeError, ValueError, ArithmeticError) as error:
            problem = f"{_KEY}.{name} is {words}: give low and high, or choices ({error})"
            raise ConfigError(problem) from error
    return space


def _distribution(given: Mapping[str, Any]) -> "BaseDistribution":
    """Choices, or numbers from `low` to `high`: integers if both are."""
    from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

    made: BaseDistribution
    if "choices" in given:
        made = CategoricalDistribution(**{**given, "choices": tuple(given["choices"])})
    else:
        whole = all(isinstance(given.get(end), int) for end in ("low", "high"))
        made = IntDistribution(**given) if whole else FloatDistribution(**given)
    if made.single():
        raise ValueError("it leaves no choice")
    return made


def _ends(distribution: Any) -> tuple[Any, ...]:
    choices: tuple[Any, ...] | None = getattr(distribution, "choices", None)
    return (distribution.low, distribution.high) if choices is None else choices


def check_within(space: Space, config: Mapping[str, Any]) -> dict[str, Any]:
    """The configuration's own values of a space's settings.

    Raises ConfigError naming a setting that is not in the configuration, or whose value there lies
    outside the space.
    """
    own, values = {}, flatten(config)
    for key, distribution in space.items():
        if key not in values:
            raise ConfigError(f"{_KEY}.{key}: the configuration has no {key}")
        value = values[key]
        low, *_, high = ends = _ends(distribution)
        is_number = isinstance(value, int | float) and not hasattr(distribution, "choices")
        if value not in ends and not (is_number and low <= value <= high):
            raise ConfigError(f"{_KEY}.{key} leaves out the configuration's own value, {value}")
        own[key] = value
    return own


def nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values by dotted key as nested mappings: {"a.b": 1} → {"a": {"b": 1}}."""
    changes: dict[str, Any] = {}
    for key, value in values.items():
        *parents, last = key.split(".")
        node = changes
        for part in parents:
            node = node.setdefault(part, {})
        node[last] = value
    return changes
