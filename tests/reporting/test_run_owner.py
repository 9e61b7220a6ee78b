import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from hlp.reporting.local_database import owner_is_dead, owner_tags


def test_this_process_lives() -> None:
    assert not owner_is_dead(owner_tags())


def test_a_process_that_ended_is_dead_also_before_it_is_waited_for() -> None:
    code = "import json; from hlp.reporting.local_database import owner_tags as tags"
    code += "; print(json.dumps(tags()))"
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    tags = json.loads(process.stdout.read())
    if sys.platform == "linux":
        while ") Z " not in Path(f"/proc/{process.pid}/stat").read_text():
            time.sleep(0.01)
        assert owner_is_dead(tags)
    process.communicate()
    assert owner_is_dead(tags)


@pytest.mark.skipif(sys.platform != "linux", reason="start times are known on Linux alone")
def test_another_process_with_the_same_id_is_not_the_owner() -> None:
    assert owner_is_dead(owner_tags() | {"hlp.process_started": "1"})


@pytest.mark.parametrize(
    "changed",
    [{"hlp.host": "another"}, {"hlp.process": "x"}, {"hlp.process": ""}, {"hlp.process": "-1"}],
)
def test_what_cannot_be_known_counts_as_alive(changed: dict[str, str]) -> None:
    assert not owner_is_dead(owner_tags() | changed)
    assert not owner_is_dead({})
