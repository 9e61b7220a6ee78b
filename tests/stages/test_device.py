import pytest
import torch

from hlp.stages.manifest import device_name


def test_the_name_is_the_gpus_model_where_a_gpu_computes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda: "RTX 5090")
    assert [device_name(each) for each in ("cuda", "gpu", "auto", "cpu")] == [
        "RTX 5090",
        "RTX 5090",
        "RTX 5090",
        "cpu",
    ]


def test_without_a_gpu_auto_is_the_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)
    assert [device_name(each) for each in ("auto", "cpu", "gpu")] == ["cpu", "cpu", "gpu"]
