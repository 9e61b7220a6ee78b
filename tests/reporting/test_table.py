import pytest

from hlp.reporting.table import (
    Table,
    check_layout,
    format_interval,
    format_share,
    lay_out,
    prose,
)


def test_text_is_aligned_and_markdown_is_a_table() -> None:
    table = Table(["object", "AD"], [["cat", "0.5"], ["holepuncher", "1"]])
    assert table.text().split("\n") == [
        "object        AD",
        "-----------  ---",
        "cat          0.5",
        "holepuncher    1",
    ]
    header, rule, *rows = table.markdown().split("\n")
    assert [cell.strip() for cell in header.split("|")] == ["", "object", "AD", ""]
    assert rule.replace("-", "") == "|:|:|"
    assert rows == ["| cat         |  0.5 |", "| holepuncher |    1 |"]


def test_cells_stay_as_they_are_and_headers_may_repeat() -> None:
    """Numbers are text already: 0.500 is not 0.5, and 1e3 is not 1000."""
    table = Table(["run", "95 %", "95 %"], [["001", "0.500", "1e3"]])
    assert table.text().split("\n")[-1].split() == ["001", "0.500", "1e3"]


def test_latex_escapes_what_it_must() -> None:
    latex = Table(["a_b", "95 %"], [["{5°, 5 mm}", "1,5"], ["θ & τ", ""]]).latex()
    assert latex.startswith(r"\begin{tabular}{lr}") and latex.endswith(r"\end{tabular}")
    lines = [" ".join(line.split()) for line in latex.split("\n")]
    assert r"a\_b & 95 \% \\" in lines
    assert r"\{5$^\circ$, 5 mm\} & 1,5 \\" in lines
    assert r"$\theta$ \& $\tau$ & \\" in lines


def test_numbers_and_layouts() -> None:
    assert (format_share(0.97949), format_share(None)) == ("0.979", "")
    assert format_interval((0.4, 1.0)) == "0.400-1.000"
    check_layout("markdown")
    with pytest.raises(ValueError, match="format=html: choose one of text, markdown"):
        check_layout("html")


def test_a_table_is_cut_to_fit_a_terminal() -> None:
    rows = [["without_verification", "0.500", "a value of many words"], ["short", "1.000", ""]]
    table = Table(["step", "AD", "against"], rows)
    fitted = table.fitted(0, 2, width=30)
    assert max(map(len, fitted.text().split("\n"))) == 30
    assert fitted.rows[0][1] == "0.500"
    assert fitted.rows[1] == rows[1]
    assert fitted.rows[0][0].endswith("…") and rows[0][0].startswith(fitted.rows[0][0][:-1])
    assert table.fitted(0, 2, width=80) == Table([*table.header], rows)
    assert table.without("AD", "against").rows == [["without_verification"], ["short"]]


def test_the_ends_of_paths_are_kept() -> None:
    fitted = Table(["run", "AD"], [["outputs/demo/2026", "1.000"]]).fitted(0, width=16, ends=True)
    assert fitted.text().split("\n")[-1] == "…emo/2026  1.000"


def test_a_table_for_a_narrow_terminal_is_in_parts() -> None:
    table = Table(["object", "a", "b", "c"], [["cat", "1.000", "2.000", "3.000"]])
    parts = [([*part.header], [[*row] for row in part.rows]) for part in table.parts(width=20)]
    assert parts == [
        (["object", "a", "b"], [["cat", "1.000", "2.000"]]),
        (["object", "c"], [["cat", "3.000"]]),
    ]
    assert [part.header for part in table.parts(width=5)] == [
        ["object", column] for column in "abc"
    ]
    assert table.parts(width=80) == [table]
    (named,) = Table(["object"], [["a_name_that_is_far_too_long"]]).parts(width=24)
    assert named.rows == [["a_name_…"]]
    wide = Table(["object", "a", "b"], [["cat", "1" * 50, "2" * 50]])
    assert lay_out(wide, "text").count("object") == 2
    assert lay_out(wide, "markdown") == wide.markdown()
    assert lay_out(table, "text") == table.text()


def test_prose_is_in_lines_on_a_terminal_alone() -> None:
    words = " ".join(["well-known"] * 20)
    assert prose(words, "markdown") == words
    lines = prose(words, "text").splitlines()
    assert max(map(len, lines)) <= 80 and " ".join(lines) == words


def test_numbers_are_not_cut_to_fit() -> None:
    table = Table(["step", "AD"], [["of a long name", "0.500" * 20]])
    assert table.fitted(0, width=30).rows[0] == ["of a …", "0.500" * 20]
