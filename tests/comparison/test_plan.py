"""Who takes part, and which jobs come of it."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from recorded import PENDULUM, pendulum_reference
from swim2real.comparison import Plan, contestant, contestants, make_plan, read_plan
from swim2real.comparison.contestants import NAMES, folder_name, table_methods
from swim2real.errors import ArgumentError, RunError
from swim2real.robots.fish import FISH
from swim2real.settings import METHODS, BriefingSettings
from swim2real.simulation import Engine


@pytest.fixture
def plan(pool) -> Plan:
    return make_plan(contestants(["random", "no-line-search"]), (0, 1), ("aligned", "paper"), 3, pool, FISH)


def keys(plan: Plan) -> list[str]:
    return [job.key for job in plan.jobs("out")]


# contestants


def test_every_method_and_the_ablation_take_part():
    assert set(NAMES) == {*METHODS, "no-line-search"}
    assert set(table_methods(FISH)) == {*NAMES} - {"mujoco-sysid"}
    assert set(table_methods(PENDULUM)) == {*NAMES} - {"mujoco-sysid", "staged"}  # nobody planned any
    for name in NAMES:
        one = contestant(name)
        assert (one.name, one.advisor, one.scale) == (name, "physics", None)
        assert one.max_steps == (1 if name == "no-line-search" else 3)
        assert one.method == ("line-search" if name == "no-line-search" else name)


def test_recordings_have_one_protocol_and_the_units_of_their_sensors(pool):
    plan = make_plan(contestants(["random"]), [0], [], 3, pendulum_reference(), PENDULUM)
    assert (plan.protocols, plan.sensors) == (("playback",), {"gyro[1]": "rad/s"})
    assert [job.key for job in plan.jobs("out")] == ["playback/random/seed-0"]
    assert make_plan(contestants(["random"]), [0], [], 3, pool, FISH).protocols == ("motion", "aligned", "paper")
    with pytest.raises(ArgumentError, match="the trials of robot 'pendulum' are recordings"):
        make_plan(contestants(["random"]), [0], ["paper"], 3, pendulum_reference(), PENDULUM)


def test_swims_begin_where_each_protocol_says_or_allows(pool, plan):
    one = make_plan(contestants(["random"]), [0], [], 3, pool, FISH, start="rest")
    assert [(job.settings.protocol, job.settings.start) for job in one.jobs("out")] == [
        ("motion", "rest"), ("aligned", "rest"), ("paper", "speed"),
    ]  # fmt: skip
    own = make_plan(contestants(["random"]), [0], [], 3, pool, FISH).jobs("out")
    assert [job.settings.start for job in own] == ["rest", "speed", "speed"]
    with pytest.raises(
        ArgumentError, match="start is 'rest', which is for steady swims under protocol motion or aligned"
    ):
        make_plan(contestants(["random"]), [0], ["paper"], 3, pool, FISH, start="rest")
    with pytest.raises(RunError, match="can't go on with another start under protocol aligned: it was speed"):
        replace(plan, start="rest").extending(plan)


def test_an_advisor_and_a_scale_are_part_of_a_name():
    one = contestant("no-line-search@google:gemini-3-pro+linear")
    assert (one.method, one.advisor, one.max_steps, one.scale) == ("line-search", "google:gemini-3-pro", 1, "linear")
    assert one.label("log") == "no-line-search@google:gemini-3-pro+linear"
    assert one.label("linear") == "no-line-search@google:gemini-3-pro"
    assert contestant("line-search@replay:some/run").advisor == "replay:some/run"
    assert contestant("line-search@physics") == contestant("line-search")


def test_scales_multiply_and_nothing_takes_part_twice():
    found = contestants(["random", "random", "line-search+log"], ["auto", "linear"])
    assert [(one.name, one.scale) for one in found] == [
        ("random", None), ("random", "linear"), ("line-search", "log"),
    ]  # fmt: skip


KNOWN = ", ".join(NAMES)
ADVISED = ", ".join(f"{name}@ADVISOR" for name in NAMES if name in ("line-search", "no-line-search"))


@pytest.mark.parametrize(
    ("name", "says"),
    [
        (
            "no-line-serch",
            f"there is no method 'no-line-serch'; there are {KNOWN}, and with another advisor {ADVISED}; "
            "did you mean 'no-line-search'?",
        ),
        ("magic", f"there is no method 'magic'; there are {KNOWN}, and with another advisor {ADVISED}"),
        ("random@physics", "method random has no advisor; write 'random' without '@physics'"),
        (
            "line-search@oracle",
            "advisor is 'oracle'; there are physics, files, replay:RUN, google:MODEL, openai:MODEL, anthropic:MODEL",
        ),
        (
            "line-search@files",
            "advisor 'files' waits for a person, and the runs of a comparison for nobody; "
            "use `swim2real calibrate --advisor files`, then '@replay:RUN' here",
        ),
    ],
    ids=lambda text: text.split(";")[0],
)
def test_what_cant_take_part_is_named(name, says):
    with pytest.raises(ArgumentError) as caught:
        contestant(name)
    assert str(caught.value) == says


def test_scales_and_methods_are_checked():
    with pytest.raises(ArgumentError, match="there is no scale 'cubic'; there are auto, log, linear"):
        contestants(["random"], ["cubic"])
    with pytest.raises(ArgumentError, match="a comparison needs a method and a scale; there are line-search, "):
        contestants([])


def test_folders_have_plain_names_and_no_two_the_same():
    labels = ["random", "random+linear", "line-search@google:gemini", "line-search@google_gemini"]
    labels += [f"line-search@replay:{path}" for path in ("/a/b", "_a_b", "/a_b", "a b", "a" * 200, "a" * 201)]
    names = [folder_name(label) for label in labels]
    assert len({name.casefold() for name in names}) == len(labels)
    assert all(set(name) <= set("abcdefghijklmnopqrstuvwxyz0123456789-_.@=+") and len(name) < 100 for name in names)
    assert names[:3] == ["random", "random+linear", "line-search@google=gemini"]


# jobs


def test_jobs_are_contestants_by_seeds_by_protocols(plan):
    assert keys(plan) == [
        f"{protocol}/{method}/seed-{seed}"
        for protocol in ("aligned", "paper") for method in ("random", "no-line-search") for seed in (0, 1)
    ]  # fmt: skip
    job = plan.jobs("out")[-1]
    assert job.folder == Path("out/runs/paper/no-line-search/seed-1")
    settings = job.settings
    assert (settings.method, settings.max_steps, settings.seed, settings.budget) == ("line-search", 1, 1, 3)
    assert (settings.protocol, settings.resolved_scale, settings.threads) == ("paper", "linear", 1)
    assert plan.methods == ("random", "no-line-search")


def test_leaving_one_out_adds_a_job_for_every_trial(plan):
    without = [f"aligned/random/seed-0{end}" for end in ("", "/without-f1_20", "/without-f1_60")]
    more = replace(plan, leave_one_out=True)
    assert keys(more)[:3] == without
    assert len(keys(more)) == 3 * len(keys(plan))
    assert [job.held_out for job in more.jobs("out")][:3] == [None, "f1_20", "f1_60"]


def test_a_protocols_own_scale_is_no_contestant_of_its_own(pool):
    plan = make_plan(contestants(["random"], ["auto", "linear"]), [0], ("aligned", "paper"), 3, pool, FISH)
    assert keys(plan) == ["aligned/random/seed-0", "aligned/random+linear/seed-0", "paper/random/seed-0"]
    assert plan.methods == ("random", "random+linear")


def test_what_cant_be_run_is_refused_before_anything_is_written(pool):
    team = contestants(["random"])
    with pytest.raises(ArgumentError, match="budget is 0; it must be at least 1"):
        make_plan(team, [0], ["aligned"], 0, pool, FISH)
    with pytest.raises(ArgumentError, match="seed is -1; it must be a whole number from 0 on"):
        make_plan(team, [-1], ["aligned"], 3, pool, FISH)
    with pytest.raises(ArgumentError, match="a comparison needs at least one method, one seed and one protocol"):
        make_plan(team, [], ["aligned"], 3, pool, FISH)
    one = replace(pool, trials=pool.trials[:1])
    with pytest.raises(ArgumentError, match="leave-one-out needs at least 2 trials; the reference has f1_20"):
        make_plan(team, [0], ["aligned"], 3, one, FISH, leave_one_out=True)


# plan.json


def test_a_plan_is_read_back_as_it_was(plan, tmp_path):
    assert read_plan(tmp_path) is None
    whole = replace(
        plan, contestants=contestants(["line-search@replay:x", "random+linear"]), leave_one_out=True, horizon=None,
        briefing=BriefingSettings("numbers", "images", "low"), source="somewhere",
    )  # fmt: skip
    whole.write(tmp_path)
    assert read_plan(tmp_path) == whole


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"format": 2}, "'format' is 2"),
        ({"seeds": 3}, "'seeds' is 3; it must be a list"),
        ({"contestants": [{"name": "magic"}]}, "there is no method 'magic'"),
        ({"budget": 0}, "budget is 0"),
        ({"protocols": ["mine"]}, r"'protocols\[0\]' is \"mine\""),
    ],
    ids=str,
)
def test_a_damaged_plan_is_a_sentence(plan, changes, says, tmp_path):
    plan.write(tmp_path)
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
    with pytest.raises(RunError, match=rf"plan '.*plan\.json': .*{says}.*; restore it or use another folder"):
        read_plan(tmp_path)
    path.write_text("{}")
    with pytest.raises(RunError, match=r"plan\.json': 'contestants' is missing"):
        read_plan(tmp_path)
    path.write_text("nothing")
    with pytest.raises(RunError, match=r"plan\.json' can't be read as JSON"):
        read_plan(tmp_path)


def test_a_larger_plan_has_all_of_the_earlier_one(plan):
    later = replace(
        plan, contestants=contestants(["least-squares", "random"]), seeds=(7,), protocols=("paper",), budget=5,
        leave_one_out=True,
    )  # fmt: skip
    both = later.extending(plan)
    assert both.methods == ("random", "no-line-search", "least-squares")
    assert (both.seeds, both.protocols, both.budget, both.leave_one_out) == ((0, 1, 7), ("aligned", "paper"), 5, True)
    assert set(keys(plan)) < set(keys(both))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (
            {"reference": "0" * 64},
            r"go on with another reference: it was \w{12} \(f1_20, f1_60\) and is now 0{12} \(f1_20, f1_60\); "
            r"use the same, or another folder",
        ),
        (
            {"engine": Engine("mujoco 9.9", "implicit", 0.001, (1.0,))},
            r"go on with another engine: it was mujoco \S+ \(implicit, 0.001 s, fluid forces \w{8}\) and is now "
            r"mujoco 9.9 \(implicit, 0.001 s, fluid forces \w{8}\); use the same",
        ),
        ({"robot": "eel"}, "go on with another robot: it was fish and is now eel; use the same"),
        ({"horizon": 2.0}, r"go on with another horizon: it was 4.0 and is now 2.0; use the same"),
        ({"budget": 2}, "has a budget of 3 evaluations and can't go on with 2; use at least as many"),
    ],
    ids=["reference", "engine", "robot", "horizon", "budget"],
)
def test_what_cant_share_a_table_is_refused(plan, changes, says):
    with pytest.raises(RunError, match=says):
        replace(plan, **changes).extending(plan)


def test_other_briefings_matter_only_where_a_vlm_is_asked(plan):
    other = replace(plan, briefing=BriefingSettings("numbers"))
    assert other.extending(plan).briefing.show == "numbers"
    asked = replace(other, contestants=contestants(["line-search@openai:some-model"]))
    with pytest.raises(RunError, match=r"go on with another briefing: it was \{'show': 'both'"):
        asked.extending(plan)


def test_other_versions_are_told_and_no_reason_to_stop(plan, caplog):
    then = replace(plan, versions={**plan.versions, "scipy": "0.1"})
    assert plan.extending(then).jobs("out") == plan.jobs("out")
    assert f"the comparison goes on with other versions: scipy 0.1 → {plan.versions['scipy']}" in caplog.text
