"""The page of a comparison: what it says, that it needs nothing else, and that a click on a column's head sorts it."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from charts import check_page, titles_of

from browser import open_to_scripts, opened
from made_results import made_results, made_run, playback_results, two_methods
from swim2real.comparison.results import ComparisonResults
from swim2real.errors import RunError
from swim2real.report.comparison_page import comparison_content, verdict, write_comparison_report

EVIL = "<script>alert('no')</script>"


def put(results: ComparisonResults, folder: Path) -> Path:
    """A comparison's folder with its results."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "results.json").write_text(json.dumps(results.as_dict()), encoding="utf-8")
    return folder


def page_of(results: ComparisonResults, folder: Path, **more) -> str:
    return write_comparison_report(put(results, folder), **more).read_text(encoding="utf-8")


def visible(page: str) -> str:
    body = re.sub(r"<(script|style|svg)\b.*?</\1>", " ", page, flags=re.DOTALL)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", body))


def three_methods() -> ComparisonResults:
    """In an order that is neither that of the names nor that of the errors; one of them ends at different errors."""
    finals = {"random": (0.03, 0.05), "line-search": (0.01, 0.012), "cma-es": (0.2, 0.02)}
    runs = [made_run(m, s, [0.2] * 7 + [loss]) for m, losses in finals.items() for s, loss in enumerate(losses)]
    return made_results(*runs)


def test_the_page_says_who_is_best_and_how_surely(tmp_path: Path) -> None:
    shown = visible(page_of(two_methods(), tmp_path / "my <b>comparison"))
    for words in (
        "my &lt;b&gt;comparison",
        "good has the lowest mean aligned marker error: 12.0 mm, and 14.0 mm with its worst seed.",
        "Next is bad, 50.0 mm above (95 % interval 50.0 mm to 50.0 mm, 3 seeds), which leaves out zero.",
        "The lowest mean AUC has good: 66.5 mm.", "12.0 ± 2.0", "8 evaluations each", "Seeds 0, 1 and 2",
        "1 planned run is not here", "aligned/absent/seed-0 : the library is not there", "not reached (0/3)",
        "Trials left out of the fit", "Proposals and line search", "mujoco 3.13.0", "d5756570ca64",
    ):  # fmt: skip
        assert words in shown, words


def test_chance_is_said() -> None:
    from swim2real.comparison.statistics import method_statistics

    runs = [made_run("a", s, [0.1] * 8) for s in range(3)]
    runs += [made_run("b", s, [0.1 + d] * 8) for s, d in enumerate((-0.02, 0.03, 0.01))]
    said = verdict(method_statistics(made_results(*runs), "aligned"))
    assert "which holds zero, so it may be chance" in said[1]
    alone = verdict(method_statistics(made_results(*runs[:1], runs[3]), "aligned"))
    assert alone[0].endswith("with a single seed.")
    assert "one seed can't tell" in alone[1]


def test_the_same_folder_gives_the_same_page(tmp_path: Path) -> None:
    assert page_of(two_methods(), tmp_path) == page_of(two_methods(), tmp_path)
    assert not list(tmp_path.glob("*.part"))


@pytest.mark.slow
def test_the_page_needs_no_network(drawn: None, tmp_path: Path) -> None:
    page = page_of(two_methods(), tmp_path)
    markup = re.sub(r"(<(script|style)\b[^>]*>).*?</\2>", r"\1", page, flags=re.DOTALL)
    tags = re.findall(r"<[^>]+>", markup)
    assert not [tag for tag in tags if re.search(r"^<(link|iframe|img|object|base)\b|\ssrc\s*=", tag)]
    assert all(target.startswith("#") for target in re.findall(r'href="([^"]*)"', markup))
    assert "default-src 'none'" in page
    assert "url(" not in "".join(re.findall(r"<style>(.*?)</style>", page, re.DOTALL))
    assert len(page) < 3e5
    check_page(page)


def test_runs_link_to_their_own_pages_where_there_are_any(tmp_path: Path) -> None:
    made = two_methods()
    there = tmp_path / "runs/aligned/good/seed-1"
    there.mkdir(parents=True)
    (there / "report.html").write_text("a page")
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures/strip-aligned.pdf").write_text("a figure")
    page = page_of(made, tmp_path)
    assert re.findall(r'href="([^"#]+)"', re.sub(r"<script\b.*?</script>", "", page, flags=re.DOTALL)) == [
        "runs/aligned/good/seed-1/report.html", "figures/strip-aligned.pdf"
    ]  # fmt: skip


def test_texts_from_results_are_escaped(tmp_path: Path) -> None:
    run = replace(made_run(EVIL, 0, [0.2] * 8), folder="runs/evil")
    page = page_of(made_results(run, missing={EVIL: EVIL}), tmp_path)
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert" in page


def test_a_protocol_without_runs_and_no_runs_at_all(tmp_path: Path) -> None:
    made = replace(three_methods(), protocols=("aligned", "paper"))
    shown = visible(page_of(made, tmp_path / "one"))
    assert "No run of this protocol has finished. Run the comparison again" in shown
    empty = replace(made, runs=())
    assert visible(page_of(empty, tmp_path / "none")).count("No run of this protocol has finished") == 2


def test_theory_is_beside_the_simulators(tmp_path: Path) -> None:
    content = comparison_content(two_methods(), tmp_path, {"slow": 0.03, "fast": 0.17})
    (board,) = content["boards"]
    assert [(name, [c.text for c in cells]) for name, cells in board.tables["velocity"].rows][-1] == (
        "elongated body theory", ["10.0", "30.0", "20.0"]
    )  # fmt: skip
    names = [
        text.get_text().partition(" (")[0] for text in content["charts"]["velocity-aligned"]().legends[0].get_texts()
    ]
    assert names == ["real", "good", "bad", "elongated body theory"]


def test_recordings_have_no_speed_against_frequency(tmp_path: Path) -> None:
    results = playback_results(sensor_errors={"load": 0.01})
    shown = visible(page_of(results, tmp_path))
    for words in (
        "good has the lowest mean playback error: 15.0 mm", "Playback protocol", "load (N)", "Error of each marker",
        "Speed against frequency is left out: the trials are recordings, which have none.",
    ):  # fmt: skip
        assert words in shown, words
    assert [word for word in ("Eq. 1", "elocity", "head to tail", "registered") if word in shown] == []
    charts = comparison_content(results, tmp_path)["charts"]
    assert set(charts) == {"convergence-playback", "strip-playback", "markers-playback"}
    assert titles_of(charts["markers-playback"]())[0] == "marker"


def test_missing_results_are_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"has no results\.json"):
        write_comparison_report(tmp_path)


# clicks on the heads of a table and writes down what comes of it
CLICKS = """
<script>addEventListener("load", () => {
  const table = document.getElementById("table-paper-aligned");
  const said = [];
  const look = (what) => said.push({
    what, order: [...table.tBodies[0].rows].map((row) => row.cells[0].textContent.trim()),
    sorts: [...table.tHead.rows[0].cells].map((head) => head.getAttribute("aria-sort")),
  });
  const buttons = [...table.querySelectorAll("thead button")];
  look("planned");
  buttons[1].click(); look("best");
  buttons[1].click(); look("best again");
  buttons[0].click(); look("method");
  buttons[2].focus();
  said.push({focus: document.activeElement === buttons[2], tab: buttons[2].tabIndex, tag: buttons[2].tagName});
  const other = document.getElementById("table-sureness-aligned");
  other.querySelectorAll("thead button")[2].click();
  const last = () => other.tBodies[0].rows[2].cells[0].textContent.trim();
  said.push({unknown: last()});
  other.querySelectorAll("thead button")[2].click();
  said.push({unknown: last()});
  const out = document.createElement("pre"); out.id = "said"; out.textContent = JSON.stringify(said);
  document.body.append(out);
});</script></body>"""


@pytest.mark.slow
def test_a_browser_shows_the_page_and_sorts_on_a_click(drawn: None, tmp_path: Path) -> None:
    results = three_methods()
    page = tmp_path / "clicked.html"
    page.write_text(open_to_scripts(page_of(results, tmp_path)).replace("</body>", CLICKS), encoding="utf-8")
    shown, told = opened(page)
    assert "CONSOLE" not in told, told[-2000:]
    found = re.search(r'<pre id="said">(.*?)</pre>', shown)
    assert found
    planned, best, again, method, focus, *unknown = json.loads(found[1])
    assert planned["order"] == ["random", "line-search", "cma-es"]
    assert best["order"] == ["line-search", "random", "cma-es"]
    assert best["sorts"] == [None, "ascending", None, None]
    assert again["order"] == ["cma-es", "random", "line-search"]
    assert again["sorts"] == [None, "descending", None, None]
    assert method["order"] == ["cma-es", "line-search", "random"]
    assert method["sorts"] == ["ascending", None, None, None]
    assert focus == {"focus": True, "tab": 0, "tag": "BUTTON"}
    # the best method has no difference to itself: last, whichever way
    assert unknown == [{"unknown": "line-search"}] * 2
