"""What a package index shows: README and links, with and without a repository's address."""

from pathlib import Path

import pytest
from hatchling.metadata.core import ProjectMetadata
from hatchling.plugin.manager import PluginManager
from markdown_pages import ROOT, links

ADDRESS = "https://git.example.org/team/hlp"


def metadata(monkeypatch: pytest.MonkeyPatch, address: str) -> ProjectMetadata:
    monkeypatch.setenv("HLP_REPOSITORY", address)
    return ProjectMetadata(str(ROOT), PluginManager())


def test_without_an_address_readme_stays_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    core = metadata(monkeypatch, "").core
    assert core.readme == (ROOT / "README.md").read_text() and core.urls == {}
    assert core.readme_content_type == "text/markdown"


@pytest.mark.parametrize("end", ["", "/"])
def test_links_and_pictures_lead_to_the_repository(
    end: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    core = metadata(monkeypatch, ADDRESS + end).core
    assert set(core.urls) == {"Source", "Documentation", "Changelog", "Issues"}
    assert all(url.startswith(ADDRESS) and "//" not in url[8:] for url in core.urls.values())
    shown = tmp_path / "README.md"
    shown.write_text(core.readme)
    before, after = [*links(ROOT / "README.md")], [*links(shown)]
    assert len(before) == len(after) > 10
    for one, other in zip(before, after, strict=True):
        if one.startswith(("http", "#")):
            assert other == one
            continue
        picture = one.endswith((".jpg", ".svg", ".webp"))
        assert other == f"{ADDRESS}/{'raw' if picture else 'blob'}/HEAD/{one}"
        assert (ROOT / one.partition("#")[0]).is_file()


@pytest.mark.parametrize(
    "address", ["git@example.org:team/hlp", "https://example.org", "http://a/b"]
)
def test_an_address_of_another_form_is_named(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match=r"HLP_REPOSITORY=.*write https://HOST/OWNER/NAME"):
        _ = metadata(monkeypatch, address).core.readme
