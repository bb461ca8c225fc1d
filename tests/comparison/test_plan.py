"""What is compared, and which jobs come of it."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from recorded import PENDULUM, pendulum_reference
from swim2real.comparison import Plan, default_methods, make_plan, method_variant, read_plan
from swim2real.comparison.plan import NAMES, folder_name
from swim2real.methods import METHODS
from swim2real.robots.fish import FISH
from swim2real.settings import BriefingSettings, ComparisonSettings
from swim2real.simulation import Engine
from swimbase.errors import ArgumentError, RunError

BASE = ComparisonSettings(methods=("random", "no-line-search"), seeds=(0, 1), protocols=("aligned", "paper"), budget=3)
ALONE = replace(BASE, methods=("random",), seeds=(0,), protocols=())


@pytest.fixture
def plan(pool) -> Plan:
    return make_plan(BASE, pool, FISH)


def keys(plan: Plan) -> list[str]:
    return [job.key for job in plan.jobs("out")]


def changed(plan: Plan, **changes) -> Plan:
    return replace(plan, settings=replace(plan.settings, **changes))


def test_every_method_and_the_ablation_can_be_compared():
    assert set(NAMES) == {*METHODS, "no-line-search"}
    by_name = {"mujoco-sysid", "multi-start", "proposal-search"}
    assert set(default_methods(FISH)) == {*NAMES} - by_name
    assert set(default_methods(PENDULUM)) == {*NAMES} - by_name - {"staged"}  # nobody planned any
    one = method_variant("no-line-search@google:gemini-3-pro+linear")
    assert (one.method, one.advisor, one.max_steps, one.scale) == ("line-search", "google:gemini-3-pro", 1, "linear")
    assert one.label("log") == "no-line-search@google:gemini-3-pro+linear"
    assert one.label("linear") == "no-line-search@google:gemini-3-pro"
    assert method_variant("line-search@replay:some/run").advisor == "replay:some/run"
    assert method_variant("line-search@physics") == method_variant("line-search")
    assert method_variant("line-search").max_steps == 3


@pytest.mark.parametrize(("name", "says"), [
    ("no-line-serch", ("no method 'no-line-serch'", "random", "line-search@ADVISOR", "mean 'no-line-search'?")),
    ("random@physics", ("method random has no advisor", "write 'random'")),
    ("line-search@oracle", ("advisor is 'oracle'", "replay:RUN", "google:MODEL")),
    ("line-search@files", ("waits for a person", "'@replay:RUN'")),
    (f"line-search@replay:{'a' * 1000}", ("there is no method 'line-search@replay",)),
])  # fmt: skip
def test_a_method_that_cant_be_compared_is_named(name, says):
    with pytest.raises(ArgumentError) as caught:
        method_variant(name)
    assert [part for part in says if part not in str(caught.value)] == []


def test_recordings_have_one_protocol_and_the_units_of_their_sensors(pool):
    plan = make_plan(ALONE, pendulum_reference(), PENDULUM)
    assert (plan.settings.protocols, plan.sensors) == (("playback",), {"gyro[1]": "rad/s"})
    assert keys(plan) == ["playback/random/seed-0"]
    assert make_plan(ALONE, pool, FISH).settings.protocols == ("motion",)


def test_folders_have_plain_names_and_no_two_the_same():
    labels = ["random", "random+linear", "line-search@google:gemini", "line-search@google_gemini"]
    labels += [f"line-search@replay:{path}" for path in ("/a/b", "_a_b", "/a_b", "a b", "a" * 200, "a" * 201)]
    names = [folder_name(label) for label in labels]
    assert len({name.casefold() for name in names}) == len(labels)
    assert all(set(name) <= set("abcdefghijklmnopqrstuvwxyz0123456789-_.@=+") and len(name) < 100 for name in names)
    assert names[:3] == ["random", "random+linear", "line-search@google=gemini"]


def test_jobs_are_methods_by_seeds_by_protocols(plan):
    assert keys(plan) == [
        f"{protocol}/{method}/seed-{seed}"
        for protocol in ("aligned", "paper") for method in ("random", "no-line-search") for seed in (0, 1)
    ]  # fmt: skip
    job = plan.jobs("out")[-1]
    assert job.folder == Path("out/runs/paper/no-line-search/seed-1")
    expected = {"method": "line-search", "max_steps": 1, "seed": 1, "budget": 3, "protocol": "paper", "threads": 1}
    assert expected.items() <= vars(job.settings).items()
    more = changed(plan, leave_one_out=True)
    assert keys(more)[:3] == [f"aligned/random/seed-0{end}" for end in ("", "/without-f1_20", "/without-f1_60")]
    assert len(keys(more)) == 3 * len(keys(plan))
    assert [job.held_out for job in more.jobs("out")][:3] == [None, "f1_20", "f1_60"]


def test_scales_multiply_but_a_protocols_own_is_no_method_of_its_own(pool):
    asked = replace(BASE, methods=("random", "random", "line-search+log"), seeds=(0,), scale=("auto", "linear"))
    assert keys(make_plan(asked, pool, FISH)) == [
        "aligned/random/seed-0", "aligned/random+linear/seed-0", "aligned/line-search/seed-0",
        "paper/random/seed-0", "paper/line-search+log/seed-0",
    ]  # fmt: skip


@pytest.mark.parametrize(("changes", "says"), [
    ({"methods": ("magic",)}, "there is no method 'magic'"),
    ({"protocols": ("playback",)}, "protocol is 'playback'"),
    ({"protocols": ("paper",), "start": "rest"}, "start is 'rest', which is for steady swims"),
    ({"leave_one_out": True}, "leave-one-out needs at least 2 trials; the reference has f1_20"),
], ids=str)  # fmt: skip
def test_what_cant_be_run_is_refused_before_anything_is_written(pool, changes, says):
    one = replace(pool, trials=pool.trials[:1])
    with pytest.raises(ArgumentError, match=says):
        make_plan(replace(BASE, **changes), one, FISH)


def test_a_plan_is_read_back_as_it_was(plan, tmp_path):
    assert read_plan(tmp_path) is None
    whole = changed(
        replace(plan, source="somewhere"), methods=("line-search@replay:x", "random+linear"), leave_one_out=True,
        horizon=None, briefing=BriefingSettings("numbers", "images", "low"),
    )  # fmt: skip
    whole.write(tmp_path)
    assert read_plan(tmp_path) == whole


@pytest.mark.parametrize(
    ("changes", "says"),
    [({"format": 1}, "'format' is 1"), ({"settings": {"seeds": 3}}, r"'settings.seeds' is 3"),
     ({"settings": {"methods": ["magic"], "protocols": ["aligned"]}}, "no method 'magic'"),
     ({"settings": {"budget": 0}}, "budget is 0"), ({"settings": {}}, "at least one method")],
    ids=str,
)  # fmt: skip
def test_a_damaged_plan_is_a_sentence(plan, changes, says, tmp_path):
    plan.write(tmp_path)
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
    with pytest.raises(RunError, match=rf"plan '.*plan\.json': .*{says}.*; restore it or use another folder"):
        read_plan(tmp_path)


def test_a_larger_plan_has_all_of_the_earlier_one(plan, caplog):
    more = {"methods": ("least-squares", "random"), "seeds": (7,), "protocols": ("paper",), "leave_one_out": True}
    then = replace(plan, versions={**plan.versions, "scipy": "0.1"})
    both = changed(plan, budget=5, **more).extending(then)
    assert both.methods == ("random", "no-line-search", "least-squares")
    settings = both.settings
    assert (settings.seeds, settings.protocols, settings.budget) == ((0, 1, 7), ("aligned", "paper"), 5)
    assert set(keys(plan)) < set(keys(both))
    assert f"the comparison goes on with other versions: scipy 0.1 → {plan.versions['scipy']}" in caplog.text


@pytest.mark.parametrize(("changes", "says"), [
    ({"reference": "0" * 64}, r"reference: it was \w{12} \(f1_20, f1_60\) and is now 0{12} "),
    ({"engine": Engine("mujoco 9.9", "implicit", 0.001, (1.0,))}, "engine: it was .* and is now mujoco 9.9 "),
    ({"robot": "eel"}, "robot: it was fish and is now eel"),
    ({"settings": replace(BASE, horizon=2.0)}, r"horizon: it was 4.0 and is now 2.0"),
    ({"settings": replace(BASE, budget=2)}, "has a budget of 3 evaluations and can't go on with 2"),
], ids=["reference", "engine", "robot", "horizon", "budget"])  # fmt: skip
def test_what_cant_share_a_table_is_refused(plan, changes, says):
    with pytest.raises(RunError, match=rf"{says}.*; use .*, or another folder"):
        replace(plan, **changes).extending(plan)
