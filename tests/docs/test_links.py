import pytest
from markdown_pages import PAGES, ROOT, links

# Written when the site is built; test_site.py checks them there.
GENERATED = ("configuration/", "command-line.md")


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_relative_links_point_to_files(path):
    missing = []
    for link in links(path):
        target = link.partition("#")[0]
        if "://" in link or not target:
            continue
        file = (path.parent / target).resolve()
        generated = file.is_relative_to(ROOT / "docs") and str(
            file.relative_to(ROOT / "docs")
        ).startswith(GENERATED)
        if not file.exists() and not generated:
            missing.append(link)
    assert not missing


def test_links_are_seen():
    assert "method.md" in set(links(ROOT / "docs" / "index.md"))
    assert "demo_panels.jpg" in set(links(ROOT / "docs" / "index.md"))
