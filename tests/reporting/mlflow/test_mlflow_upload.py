"""Runs that a server does not hear of, and MLflow's server as `hlp ui` starts it."""

import socket
from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np
import pytest
from mlflow import MlflowClient

from hlp.errors import HlpError
from hlp.reporting.mlflow.pages import newest_page, run_path, server
from hlp.reporting.mlflow.tracking import PARENT, ChildRun, MlflowSettings, as_child_run, track_run
from hlp.reporting.mlflow.upload import send_runs, unsent_database


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def files(client: MlflowClient, run_id: str) -> set[str]:
    return {artifact.path for artifact in client.list_artifacts(run_id)}


def history(client: MlflowClient, run_id: str, name: str) -> list[tuple[int, float]]:
    return [(point.step, point.value) for point in client.get_metric_history(run_id, name)]


@pytest.mark.slow
@pytest.mark.thorough
def test_what_a_dead_server_misses_is_sent_later(tmp_path: Path) -> None:
    """A sweep's parent before the server starts, its run while it runs, and ends while it is away.

    In the end the server has both, as if it had been there all the time.
    """
    port, own = free_port(), f"sqlite:///{tmp_path / 'server' / 'mlflow.db'}"
    unsent = unsent_database(tmp_path / "work")
    settings = MlflowSettings(
        uri=f"http://127.0.0.1:{port}", experiment="swept", about="A sweep.", unsent=unsent
    )
    picture = tmp_path / "figure.png"
    cv2.imwrite(str(picture), np.full((8, 8, 3), 200, np.uint8))
    with track_run(settings, "sweep", {"a": {"b": 1}}, params={"a.b": "1"}) as parent:
        for step in range(3):
            parent.log_metrics({"sweep/add": step / 4}, step)
        parent.log_image(picture, "figure", 0)
        parent.describe("The best.\n\nAll runs.")
        parent.log_input("frames", "12ab", "there", "evaluation")
    assert Path(unsent.removeprefix("sqlite:///")).is_file()
    with pytest.raises(HlpError, match="still away"):
        send_runs(unsent)

    with ExitStack() as first_server:
        first_server.enter_context(server(own, port))
        child = ChildRun("seed 1", parent.run_id, {"seed": "1"})
        with as_child_run(child), track_run(settings, "", {}) as swept:
            begun_as = swept.run_id
            swept.log_metrics({"add": 0.5})
            first_server.close()
            assert swept.log_training("encoder", "1f2e", [{"loss": 0.25}]) == ""  # the first to ask
            swept.log_metrics({"ms": 40.0})
            swept.log_artifact(picture)

    with server(own, port):
        assert send_runs(unsent) == ["sweep", "seed 1"]
        client = MlflowClient(settings.uri)
        experiment = client.get_experiment_by_name("swept")
        assert experiment.tags["mlflow.note.content"] == "A sweep."
        runs = {run.info.run_name: run for run in client.search_runs([experiment.experiment_id])}
        sent, continued = runs["sweep"], runs["seed 1"]
        assert len(runs) == 2
        here = run_path(experiment.experiment_id, sent.info.run_id)[1:]
        view = f"[This page with the menu of model training]({here})"
        assert sent.data.tags["mlflow.note.content"] == f"The best.\n\n{view}\n\nAll runs."
        assert {run.info.status for run in runs.values()} == {"FINISHED"}
        assert sent.data.params == {"a.b": "1"}
        assert history(client, sent.info.run_id, "sweep/add") == [(0, 0.0), (1, 0.25), (2, 0.5)]
        assert [logged.dataset.name for logged in sent.inputs.dataset_inputs] == ["frames"]
        assert files(client, sent.info.run_id) == {"config.yaml", "images"}
        assert continued.info.run_id == begun_as
        assert continued.data.metrics == {"add": 0.5, "ms": 40.0, "encoder/loss": 0.25}
        assert continued.data.tags[PARENT] == sent.info.run_id
        assert files(client, begun_as) == {"config.yaml", "figure.png"}
        page = f"/#/experiments/{experiment.experiment_id}/runs?workflowType=machine_learning"
        assert newest_page(settings.uri).startswith(page)
    assert not (tmp_path / "work" / "unsent").exists()
