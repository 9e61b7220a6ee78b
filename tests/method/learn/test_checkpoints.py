import os
import pickle
from pathlib import Path

import pytest
import torch

from hlp.checksums import content_checksum
from hlp.errors import DataError
from hlp.method.learn.training import CheckpointFiles, last_checkpoint

CHECKPOINT = {"state_dict": {"weight": torch.arange(6.0).reshape(2, 3)}, "epoch": 3, "rows": [{}]}


@pytest.fixture
def two(tmp_path: Path) -> list[Path]:
    paths = [tmp_path / f"epoch-{epoch:06d}.ckpt" for epoch in (2, 3)]
    for path in paths:
        CheckpointFiles().save_checkpoint(CHECKPOINT, path)
    return paths


def test_a_checkpoint_comes_back(two: list[Path]) -> None:
    back = CheckpointFiles().load_checkpoint(two[1])
    assert torch.equal(back["state_dict"]["weight"], CHECKPOINT["state_dict"]["weight"])
    assert back["epoch"] == 3 and back["rows"] == [{}]
    assert last_checkpoint(two[1].parent) == two[1]


DAMAGE = {
    "empty": lambda content: b"",
    "cut": lambda content: content[:-100],
    "flipped": lambda content: content[:200] + bytes([content[200] ^ 1]) + content[201:],
    "checksum flipped": lambda content: bytes([content[0] ^ 1]) + content[1:],
    "garbage": lambda content: os.urandom(1000),
}


@pytest.mark.parametrize("how", DAMAGE)
def test_a_damaged_checkpoint_is_dropped_for_the_one_before(
    two: list[Path], how: str, caplog: pytest.LogCaptureFixture
) -> None:
    two[1].write_bytes(DAMAGE[how](two[1].read_bytes()))
    with pytest.raises(DataError, match=r"epoch-000003\.ckpt is damaged"):
        CheckpointFiles().load_checkpoint(two[1])
    assert last_checkpoint(two[1].parent) == two[0]
    assert not two[1].exists()
    (message,) = caplog.messages
    assert str(two[1]) in message
    two[0].write_bytes(b"")
    assert last_checkpoint(two[1].parent) is None


def test_no_checkpoint_is_the_last_of_none(tmp_path: Path) -> None:
    assert last_checkpoint(tmp_path / "absent") is None


class Attack:
    def __init__(self, touched: Path) -> None:
        self.touched = touched

    def __reduce__(self):
        return os.mkdir, (str(self.touched),)


@pytest.mark.filterwarnings("ignore:Detected pickle protocol")  # not torch's own: an attack
@pytest.mark.parametrize("by", ["torch", "pickle"])
def test_a_strangers_checkpoint_runs_no_code(tmp_path: Path, by: str) -> None:
    """Its checksum is right: whoever writes code can also compute checksums."""
    path, touched = tmp_path / "epoch-000009.ckpt", tmp_path / "touched"
    if by == "torch":
        torch.save({"state_dict": Attack(touched)}, tmp_path / "bare")
        content = (tmp_path / "bare").read_bytes()
    else:
        content = pickle.dumps(Attack(touched))
    path.write_bytes(content_checksum(content).encode() + b"\n" + content)
    assert last_checkpoint(tmp_path) is None
    assert not touched.exists()
    pickle.loads(pickle.dumps(Attack(touched)))
    assert touched.exists()  # the attack works where it is unpickled
