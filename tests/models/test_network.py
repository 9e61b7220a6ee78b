import shutil
import time

import numpy as np
import onnxruntime
import pytest
import torch
from torch import nn

from hlp.errors import DataError, MissingDependencyError, MissingFileError
from hlp.models import network
from hlp.models.network import INTEGER, SINGLE, Network, _has_vnni, load_network, require_device
from hlp.models.onnx_export import export_network
from hlp.threads import ThreadTeam


@pytest.fixture(scope="module")
def stem(tmp_path_factory):
    torch.manual_seed(0)
    layers = [nn.Conv2d(4, 8, 3, stride=2, padding=1), nn.LeakyReLU(0.1), nn.Flatten()]
    layers.append(nn.Linear(8 * 16 * 16, 5))
    stem = tmp_path_factory.mktemp("network") / "net.work"
    export_network(layers, torch.rand(32, 4, 32, 32) * 2 - 1, stem, levels=False)
    return stem


def images(count=33):
    return np.random.default_rng(0).uniform(-1, 1, (count, 32, 32, 4)).astype(np.float32)


def test_threads_and_company_change_nothing(stem):
    one, three = load_network(stem, threads=1), load_network(stem, threads=3)
    assert one.outputs == 5
    together = one.run(images())
    np.testing.assert_array_equal(three.run(images()), together)
    np.testing.assert_array_equal(three.run(images()[7:9]), together[7:9])


def test_a_thread_of_a_team_computes_alone_whatever_becomes_of_the_file(
    stem, tmp_path, monkeypatch
):
    opened = []
    session = onnxruntime.InferenceSession

    def open_session(content, options, **how):
        opened.append(options.intra_op_num_threads)
        time.sleep(0.05)  # a second thread would open another one meanwhile
        return session(content, options, **how)

    monkeypatch.setattr("onnxruntime.InferenceSession", open_session)
    shutil.copy(stem.with_name(stem.name + INTEGER), tmp_path)
    two = load_network(tmp_path / stem.name, threads=2)
    (tmp_path / (stem.name + INTEGER)).write_bytes(b"")
    expected = two.run(images())
    assert opened == [2]
    team = ThreadTeam(2)
    for _ in range(2):
        for found in team.map(lambda _: two.run(images()), 2):
            np.testing.assert_array_equal(found, expected)
    assert opened == [2, 1]
    assert team.map(lambda _: len(two.run(images(4))), 1) == [4] and opened == [2, 1]


def test_a_cpu_computes_in_integers(stem):
    single, integer = (Network(stem.with_name(stem.name + e), 1) for e in (SINGLE, INTEGER))
    found = load_network(stem, threads=1).run(images())
    np.testing.assert_array_equal(found, integer.run(images()))
    assert (found != single.run(images())).any()


def test_a_network_that_is_not_there_is_named(stem, tmp_path):
    with pytest.raises(MissingFileError, match=r"no net\.work\.int8\.onnx"):
        load_network(tmp_path / "net.work", threads=1)
    shutil.copy(stem.with_name("net.work.onnx"), tmp_path)
    with pytest.raises(MissingFileError, match=r"no net\.work\.int8\.onnx"):
        load_network(tmp_path / "net.work", threads=1)


@pytest.mark.parametrize("kept", [0, 5, 1000])
def test_a_damaged_file_is_named(kept, stem, tmp_path):
    damaged = tmp_path / "net.onnx"
    damaged.write_bytes(stem.with_name(stem.name + INTEGER).read_bytes()[:kept])
    with pytest.raises(DataError, match=r"net\.onnx is damaged"):
        Network(damaged, 1)


def test_a_device_that_onnx_runtime_lacks_is_named(monkeypatch):
    monkeypatch.setattr("onnxruntime.get_available_providers", lambda: ["CPUExecutionProvider"])
    require_device("cpu")
    with pytest.raises(MissingDependencyError, match=r"machine\.device is cuda.*onnxruntime-gpu"):
        require_device("cuda")


def test_a_device_that_does_not_work_is_not_replaced_by_the_cpu(stem, monkeypatch):
    """ONNX Runtime goes on without a word where the libraries of a device do not load."""
    monkeypatch.setitem(network._PROVIDERS, "cuda", ("AzureExecutionProvider", {}))
    monkeypatch.setattr(
        "onnxruntime.InferenceSession.get_providers", lambda _: ["CPUExecutionProvider"]
    )
    load_network(stem, threads=1)
    with pytest.raises(MissingDependencyError, match=r"machine\.device is cuda.*do not load"):
        load_network(stem, threads=1, device="cuda")


def test_what_is_not_known_of_a_processor_is_not_relied_upon(tmp_path):
    flags = tmp_path / "cpuinfo"
    assert not _has_vnni(flags)
    flags.write_text("flags : fpu avx2 avx512f")
    assert not _has_vnni(flags)
    flags.write_text("flags : fpu avx2 avx512_vnni")
    assert _has_vnni(flags)
