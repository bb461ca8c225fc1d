"""The page of a comparison: what it says, and that a click on a column's head sorts it."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from made_pages import check_charts, missing, seen_by, titles_of, visible

from made_results import made_results, made_run, playback_results, two_methods
from swim2real.comparison.results import ComparisonResults
from swim2real.comparison.statistics import method_statistics
from swim2real.report.comparison_page import comparison_context, verdict, write_comparison_report
from swimbase.errors import RunError


def page_of(results: ComparisonResults, folder: Path, **more) -> str:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "results.json").write_text(json.dumps(results.as_dict()), encoding="utf-8")
    return write_comparison_report(folder, **more).read_text(encoding="utf-8")


def three_methods() -> ComparisonResults:
    """In an order that is neither that of the names nor that of the errors; one of them ends at different errors."""
    finals = {"random": (0.03, 0.05), "line-search": (0.01, 0.012), "cma-es": (0.2, 0.02)}
    runs = [made_run(m, s, [0.2] * 7 + [loss]) for m, losses in finals.items() for s, loss in enumerate(losses)]
    return made_results(*runs)


def test_the_page_says_who_is_best_and_how_surely(tmp_path: Path) -> None:
    page = page_of(two_methods(), tmp_path / "my <b>comparison")
    words = (
        "my &lt;b&gt;comparison", "the lowest mean aligned marker error: 12.0 mm", "14.0 mm with its worst seed",
        "Next is bad, 50.0 mm above (95 % interval 50.0 mm to 50.0 mm, 3 seeds)", "66.5 mm", "12.0 ± 2.0",
        "1 planned run is not here", "aligned/absent/seed-0 : the library is not there", "not reached (0/3)",
    )  # fmt: skip
    assert missing(words, visible(page)) == []
    runs = [made_run("a", s, [0.1] * 8) for s in range(3)]
    runs += [made_run("b", s, [0.1 + d] * 8) for s, d in enumerate((-0.02, 0.03, 0.01))]
    assert "may be chance" in verdict(method_statistics(made_results(*runs), "aligned"))[1]
    assert "one seed" in verdict(method_statistics(made_results(*runs[:1], runs[3]), "aligned"))[1]


def test_runs_link_to_their_own_pages_where_there_are_any(tmp_path: Path) -> None:
    for path in ("runs/aligned/good/seed-1/report.html", "figures/strip-aligned.pdf"):
        (tmp_path / path).parent.mkdir(parents=True)
        (tmp_path / path).write_text("a page or a figure")
    page = re.sub(r"<script\b.*?</script>", "", page_of(two_methods(), tmp_path), flags=re.DOTALL)
    assert re.findall(r'href="([^"#]+)"', page) == [
        "runs/aligned/good/seed-1/report.html", "figures/strip-aligned.pdf"
    ]  # fmt: skip


def test_a_protocol_without_runs_and_no_results_at_all(tmp_path: Path) -> None:
    made = replace(three_methods(), protocols=("aligned", "paper"))
    says = "No run of this protocol has finished"
    assert visible(page_of(made, tmp_path / "one")).count(says) == 1
    assert visible(page_of(replace(made, runs=()), tmp_path / "none")).count(says) == 2
    with pytest.raises(RunError, match=r"has no results\.json"):
        write_comparison_report(tmp_path)


def test_recordings_have_no_speed_against_frequency(tmp_path: Path) -> None:
    results = playback_results(sensor_errors={"load": 0.01})
    shown = visible(page_of(results, tmp_path))
    words = (
        "good has the lowest mean playback error: 15.0 mm", "Playback protocol", "load (N)", "Error of each marker",
        "Speed against frequency is left out",
    )  # fmt: skip
    assert missing(words, shown) == []
    assert [word for word in ("Eq. 1", "elocity", "head to tail", "registered") if word in shown] == []
    charts = comparison_context(results, tmp_path).charts
    assert set(charts) == {"convergence-playback", "strip-playback", "markers-playback"}
    assert titles_of(charts["markers-playback"]())[0] == "marker"


# clicks on the heads of a table and says what comes of it
CLICKS = """
  const table = document.getElementById("table-paper-aligned");
  const look = () => [
    [...table.tBodies[0].rows].map((row) => row.cells[0].textContent.trim()),
    [...table.tHead.rows[0].cells].map((head) => head.getAttribute("aria-sort"))];
  const buttons = [...table.querySelectorAll("thead button")];
  const said = [look()];
  for (const k of [1, 1, 0]) { buttons[k].click(); said.push(look()); }
  buttons[2].focus();
  said.push([document.activeElement === buttons[2], buttons[2].tabIndex, buttons[2].tagName]);
  const other = document.getElementById("table-sureness-aligned");
  for (const _ of [1, 2]) {
    other.querySelectorAll("thead button")[2].click();
    said.push(other.tBodies[0].rows[2].cells[0].textContent.trim()); }
  return said;"""


@pytest.mark.slow
def test_a_browser_shows_the_page_and_sorts_on_a_click(drawn: None, tmp_path: Path) -> None:
    page = page_of(three_methods(), tmp_path)
    check_charts(page)
    assert len(page) < 3e5
    planned, best, again, method, focus, *unknown = seen_by(page, tmp_path / "clicked.html", CLICKS)
    assert planned[0] == ["random", "line-search", "cma-es"]
    assert best == [["line-search", "random", "cma-es"], [None, "ascending", None, None]]
    assert again == [["cma-es", "random", "line-search"], [None, "descending", None, None]]
    assert method == [["cma-es", "line-search", "random"], ["ascending", None, None, None]]
    assert focus == [True, 0, "BUTTON"]
    # the best method has no difference to itself: last, whichever way
    assert unknown == ["line-search"] * 2
