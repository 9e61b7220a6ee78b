from hlp.reporting.table import Table, format_interval, format_share, lay_out, prose


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


def test_names_are_cut_to_fit_a_terminal_of_paths_their_beginnings() -> None:
    rows = [["without_verification", "0.500"], ["outputs/demo/2026/x", "1.000"], ["short", ""]]
    (fitted,) = Table(["step", "AD"], rows).parts(width=20)
    assert [row[0] for row in fitted.rows] == ["without_veri…", "…/demo/2026/x", "short"]
    assert max(map(len, fitted.text().split("\n"))) == 20


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
    wide = Table(["object", "a", "b"], [["cat", "1" * 50, "2" * 50]])
    assert lay_out(wide, "text").count("object") == 2
    assert lay_out(wide, "markdown") == wide.markdown()


def test_prose_is_in_lines_on_a_terminal_alone() -> None:
    words = " ".join(["well-known"] * 20)
    assert prose(words, "markdown") == words
    lines = prose(words, "text").splitlines()
    assert max(map(len, lines)) <= 80 and " ".join(lines) == words
