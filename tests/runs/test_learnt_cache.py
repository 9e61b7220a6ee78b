import pytest

from hlp.method.learn.learnt_folder import LearntRecord, write_record
from hlp.method.settings import MethodSettings
from hlp.runs import learnt_cache


@pytest.fixture
def cache(tmp_path):
    for name in ("bolt", "two"):
        folder = tmp_path / "objects" / name
        write_record(folder, LearntRecord({name: 1}, (1,), MethodSettings()))
        (folder / "big").write_bytes(bytes(1000))
    return learnt_cache.cache_folder(str(tmp_path))


def test_what_is_learnt_is_found_by_name_and_by_path(cache, tmp_path):
    assert learnt_cache.find_learnt("bolt", cache) == cache / "bolt"
    assert learnt_cache.find_learnt(str(cache / "two"), tmp_path) == cache / "two"
    with pytest.raises(FileNotFoundError, match="holds bolt, two"):
        learnt_cache.find_learnt("nut", cache)
    assert [entry.name for entry in learnt_cache.list_learnt(cache)] == ["bolt", "two"]
    entry = learnt_cache.describe_learnt(cache / "two")
    assert entry.size > 1000 and entry.objects == ("two",)
    assert learnt_cache.list_learnt(tmp_path / "none") == []


def test_a_damaged_entry_is_listed_and_can_be_removed(cache):
    (cache / "bolt" / "learnt.json").write_text("{")
    bolt, two = learnt_cache.list_learnt(cache)
    assert bolt.objects == () and str(cache / "bolt" / "learnt.json") in bolt.problem
    assert two.objects == ("two",) and two.problem == ""
    assert learnt_cache.remove_learnt("bolt", cache) == cache / "bolt"


def test_only_entries_of_the_cache_are_removed_from_wherever_one_is(cache, monkeypatch):
    monkeypatch.chdir(cache)
    for wrong in (str(cache / "bolt"), "..", "../objects"):
        with pytest.raises(ValueError, match="is not a name"):
            learnt_cache.remove_learnt(wrong, cache)
    (cache / "stray").mkdir()
    for wrong in ("nut", "stray"):
        with pytest.raises(FileNotFoundError, match=f"holds no {wrong}"):
            learnt_cache.remove_learnt(wrong, cache)
    assert learnt_cache.remove_learnt("bolt", cache) == cache / "bolt"
    assert sorted(path.name for path in cache.iterdir()) == ["stray", "two"]


def test_an_exported_copy_stands_alone(cache, tmp_path):
    learnt_cache.export_learnt(learnt_cache.find_learnt("two", cache), tmp_path / "copy")
    learnt_cache.remove_learnt("two", cache)
    assert learnt_cache.find_learnt(str(tmp_path / "copy"), cache) == tmp_path / "copy"
    with pytest.raises(ValueError, match="exists already"):
        learnt_cache.export_learnt(cache / "bolt", tmp_path / "copy")


def test_by_default_it_is_the_users_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert learnt_cache.cache_folder(None) == tmp_path / "hlp" / "objects"
